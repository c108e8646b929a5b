"""The lesson's five checks of a fused detector: each takes data and gives figures and a verdict."""
