"""Which folder holds which package; everything else that setuptools asks for stands in pyproject.toml.

``slamgym.agents`` and ``slamgym.gan`` lie in folders of their own at the top of the repository.
"""

from setuptools import find_packages, setup

FOLDERS = {"slamgym": "slamgym", "slamgym.agents": "agents", "slamgym.gan": "gan"}

setup(
    package_dir=FOLDERS,
    packages=[
        package
        for name, folder in FOLDERS.items()
        for package in (name, *(f"{name}.{below}" for below in find_packages(folder)))
    ],
)
