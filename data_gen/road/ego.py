"""The body of the ego vehicle: what traffic keeps clear of and sensors are mounted on. Metres."""

EGO_SIZE = (5.0, 2.0)
"""Length and width."""
REAR_AXLE = 1.35
"""From the middle back to the rear axle, over which the ego frame has its origin."""
EGO_OUTLINE = ((REAR_AXLE - EGO_SIZE[0] / 2, REAR_AXLE + EGO_SIZE[0] / 2), (-EGO_SIZE[1] / 2, EGO_SIZE[1] / 2))
"""(back, front), (right, left) in the ego frame."""
