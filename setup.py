"""The layers at the top of a checkout are installed as packages of `softlab`; all else is in pyproject.toml."""

from setuptools import find_packages, setup

LAYERS = ("model", "cpu_backend", "gpu_backend", "app", "bench", "plots", "labbook")

setup(
    packages=["softlab"]
    + [
        f"softlab.{name}"
        for layer in LAYERS
        for name in (layer, *(f"{layer}.{inner}" for inner in find_packages(layer)))
    ],
    package_dir={"softlab": "softlab"} | {f"softlab.{layer}": layer for layer in LAYERS},
)
