"""A package that is missing is named with the command that installs it, wherever it is met."""

import json
import os
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest

from thruster_envs.extras import EXTRAS, extra, require

ROOT = Path(__file__).parents[1]

#: What needs an extra: the extra, a package of it, and code that meets it.
MEETINGS = [
    ("multi-agent", "pettingzoo", "import thruster_envs.formation_keeping_v1"),
    ("multi-agent", "pettingzoo", "import thruster_envs.formation_attitude_v1"),
    ("multi-agent", "pettingzoo", "from thruster_envs.views import FormationParallelEnv"),
    ("sb3", "stable_baselines3", "from thruster_envs.views import SB3VecEnv"),
    ("sb3", "torch", "from thruster_envs.views import SharedPolicyVecEnv"),
    ("render", "pygame", "from thruster_envs.rendering import Renderer; Renderer(400, 400)"),
    (
        "recordings",
        "pyarrow",
        "from thruster_envs.recordings import Recording; Recording({}, {}, [], []).save('flights.parquet')",
    ),
    (
        "render",
        "pygame",
        "import gymnasium, thruster_envs\n"
        "env = gymnasium.make('thruster_envs/OrionRendezvous-v1', render_mode='rgb_array')\n"
        "env.reset(seed=0); env.render()",
    ),
    ("baselines", "scipy", "import thruster_baselines.mapping"),
    (
        "baselines",
        "scipy",
        "from thruster_baselines.statistics import clopper_pearson; clopper_pearson(1, 2)",
    ),
    ("baselines", "scipy", "import thruster_baselines.detection.pulses"),
    (
        "baselines",
        "scipy",
        "from thruster_baselines.detection.calibration import chi_squared_threshold\n"
        "chi_squared_threshold(0.1)",
    ),
    (
        "baselines",
        "scipy",
        "from thruster_baselines.detection.residuals import CorrelationDetector; "
        "CorrelationDetector('msr_chaser', 0.02)",
    ),
    ("baselines", "highspy", "import thruster_baselines.guidance"),
    ("baselines", "highspy", "import thruster_baselines.control"),
    (
        "baselines",
        "clarabel",
        "from thruster_baselines.mapping import ConicRobustMapper\n"
        "ConicRobustMapper('orion', spread=0.1)([1e-3] * 6)",
    ),
    (
        "baselines",
        "daqp",
        "from thruster_baselines.mapping import QuadraticMapper; QuadraticMapper('orion')([1e-3] * 6)",
    ),
    *(("agents", package, "import thruster_agents") for package in EXTRAS["agents"]),
    ("agents", "safetensors", "import thruster_agents.dynamic_neurons"),
    ("agents", "torch", "import runpy; runpy.run_path('train.py', run_name='__main__')"),
    ("agents", "matplotlib", "import reproductions"),
    ("baselines", "highspy", "import reproductions.__main__"),
    ("bench", "torch", "import benchmarks"),
    ("bench", "clarabel", "import benchmarks.__main__"),
]

#: Loads what all of them load, then meets each in a fork of its own, with the package hidden.
_PROGRAM = """
import json, os, sys
from importlib.abc import MetaPathFinder
import thruster_envs.views.environments

class Hidden(MetaPathFinder):
    def __init__(self, package):
        self.package = package
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == self.package:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

for package, code in json.loads(sys.argv[1]):
    sys.stdout.flush()
    if os.fork() == 0:
        sys.meta_path.insert(0, Hidden(package))
        try:
            exec(code, {"__name__": "meeting"})
            said = ["", "nothing"]
        except ModuleNotFoundError as error:
            said = [error.name, str(error)]
        print("said" + json.dumps(said), flush=True)
        os._exit(0)
    os.wait()
"""


@pytest.fixture(scope="module")
def answers():
    """What each meeting came to: the name that the error has, and its text."""
    ran = subprocess.run(
        [sys.executable, "-c", _PROGRAM, json.dumps([meeting[1:] for meeting in MEETINGS])],
        cwd=ROOT, env=os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    said = [json.loads(line[4:]) for line in ran.stdout.splitlines() if line.startswith("said")]
    assert len(said) == len(MEETINGS), ran.stderr
    return dict(zip(MEETINGS, said, strict=True))


@pytest.mark.parametrize("meeting", MEETINGS, ids=lambda one: f"{one[1]}, {one[2][-60:]}")
def test_what_misses_is_named_with_the_command(meeting, answers):
    name, package, _ = meeting
    named, line = answers[meeting]
    assert named == package
    assert line.endswith(f' needs {EXTRAS[name][package]}: pip install "thruster-envs[{name}]"')
    assert "\n" not in line


def test_the_table_is_that_of_the_project():
    optional = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for name, packages in EXTRAS.items():
        assert set(packages.values()) <= installed_by(optional, name)
        if name != "bench":  # which also installs peers
            assert set(packages.values()) == installed_by(optional, name)


def installed_by(optional, name):
    """The distributions that an extra installs, extras within it followed."""
    found = set()
    for requirement in optional[name]:
        if requirement.startswith("thruster-envs["):
            for other in requirement.partition("[")[2].rstrip("]").split(","):
                found |= installed_by(optional, other)
        else:
            found.add(requirement.partition(">=")[0])
    return found


def test_other_missing_modules_stay_as_they_are():
    with pytest.raises(ModuleNotFoundError, match=r"^No module named 'thruster_envs\.no_such'$"):  # noqa: SIM117
        with extra("agents", "this"):
            import thruster_envs.no_such  # noqa: F401
    for name, packages in EXTRAS.items():
        if all(find_spec(package) for package in packages):
            require(name, "this")


def test_the_readme_names_every_extra():
    readme = (ROOT / "README.md").read_text()
    assert all(f"`{name}`" in readme for name in EXTRAS)
