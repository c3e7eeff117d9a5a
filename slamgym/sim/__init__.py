"""The simulated world and its sensors: robot, contacts, furniture, people, laser, wheel odometry."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
