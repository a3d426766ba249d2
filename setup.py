"""The packages: those of cvkern/, and the folders of kernels/ as packages of cvkern.kernels.

Everything else is said in pyproject.toml.
"""

from setuptools import find_packages, setup

setup(
    packages=[
        *find_packages(include=["cvkern", "cvkern.*"], exclude=["cvkern.kernels*"]),
        *(f"cvkern.{name}" for name in find_packages(include=["kernels", "kernels.*"])),
    ]
)
