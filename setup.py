"""What pyproject.toml cannot say: the option files, which stand beside app/, are installed inside of it."""

from setuptools import find_packages, setup

setup(
    packages=[*find_packages(include=["app", "app.*"]), "app.petsc_options"],
    package_dir={"app.petsc_options": "petsc_options"},
)
