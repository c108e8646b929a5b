"""The failure lab: a page in the browser on which the sensors of a scene are broken one by one and the real network answers."""
