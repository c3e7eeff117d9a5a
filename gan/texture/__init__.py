"""A network that draws the texture of a SLAM map over what a robot without errors would have counted."""

__all__: list[str] = []
