"""Driving the wheels: a policy from what the robot sees to its speed, and how it is trained."""

__all__: list[str] = []
