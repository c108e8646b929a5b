"""Counter-based random streams: those of :mod:`fusion_net.random`, so that a fault drawn here is the one the reader draws."""

from fusion_net.random import stream

__all__ = ["stream"]
