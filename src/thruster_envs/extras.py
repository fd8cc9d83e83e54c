"""Packages that come with an extra of this one, and the command that installs it where they miss.

Modules that need such a package import it under :func:`extra`. A package of ours of which nothing works
without an extra asks :func:`require`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

#: Extra to what it installs: the name under which it is imported, and under which it is installed.
EXTRAS: dict[str, dict[str, str]] = {
    "baselines": {"scipy": "scipy", "highspy": "highspy", "clarabel": "clarabel", "daqp": "daqp"},
    "multi-agent": {"pettingzoo": "pettingzoo"},
    "sb3": {"torch": "torch", "stable_baselines3": "stable-baselines3"},
    "agents": {
        "torch": "torch",
        "safetensors": "safetensors",
        "stable_baselines3": "stable-baselines3",
        "tensorboard": "tensorboard",
        "tqdm": "tqdm",
        "rich": "rich",
        "tyro": "tyro",
        "matplotlib": "matplotlib",
    },
    "render": {"pygame": "pygame-ce", "moviepy": "moviepy"},
    "recordings": {"pyarrow": "pyarrow"},
}
#: Beside these the benchmarks have peers, of which any may miss.
EXTRAS["bench"] = EXTRAS["baselines"] | EXTRAS["multi-agent"] | EXTRAS["agents"]


@contextmanager
def extra(name: str, what: str) -> Iterator[None]:
    """Import what an extra installs.

    Args:
        name: Of the extra.
        what: Needs it, in words.

    Raises:
        ModuleNotFoundError: Where a package of that extra misses: one line with the command.

    >>> with extra("multi-agent", "a formation of agents"):
    ...     import pettingzoo
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in EXTRAS[name]:
            raise
        raise _missing(package, name, what) from None


def require(name: str, what: str) -> None:
    """Refuse to go on without the packages of an extra, none of which is imported.

    Args:
        name: Of the extra.
        what: Needs it, in words.

    Raises:
        ModuleNotFoundError: Where one of them misses: one line with the command.
    """
    for package in EXTRAS[name]:
        with extra(name, what):
            if find_spec(package) is None:
                raise ModuleNotFoundError(name=package)


def _missing(package: str, name: str, what: str) -> ModuleNotFoundError:
    return ModuleNotFoundError(
        f'{what} needs {EXTRAS[name][package]}: pip install "thruster-envs[{name}]"', name=package
    )
