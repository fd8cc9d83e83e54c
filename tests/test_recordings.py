"""Recordings: episodes of any lengths, and files that give back the same bits or are refused in one line."""

import random

import numpy as np
import pytest

from thruster_envs.recordings import Channel, Recording, concatenate

LENGTHS = (3, 0, 5)
ENDINGS = (".npz", ".csv", ".parquet")


def recording(sources=({"environment": "x", "orbits": [0.5]},)):
    rng = np.random.default_rng(0)
    channels = {
        "time": Channel("instant", "s"),
        "position": Channel("instant", "m", (("1", "2"), ("x", "y", "z"))),
        "observation": Channel("instant", "1", (("0", "1"),)),
        "duty": Channel("step", "1", (("1", "2"),)),
        "reward": Channel("step"),
        "alarm": Channel("step"),
        "fault/kind": Channel("episode", "1", (("1", "2"),)),
        "terminated": Channel("episode"),
    }
    steps, instants = sum(LENGTHS), sum(LENGTHS) + len(LENGTHS)
    arrays = {
        "time": np.array([np.inf, np.nan, -0.0, *rng.normal(size=instants - 3)]),
        "position": rng.normal(size=(instants, 2, 3)) * 10.0 ** rng.integers(-300, 300, (instants, 2, 3)),
        "observation": rng.normal(size=(instants, 2)).astype(np.float32),
        "duty": rng.random((steps, 2)),
        "reward": rng.normal(size=steps),
        "alarm": rng.random(steps) > 0.5,
        "fault/kind": np.array([[1, 0], [2**62, -3], [0, 0]]),
        "terminated": np.array([True, False, True]),
    }
    return Recording(channels, arrays, LENGTHS, [2**100, 1, 2], sources)


def assert_same(one, other):
    assert (one.channels, one.seeds, one.metadata) == (other.channels, other.seeds, other.metadata)
    assert one.lengths.tolist() == other.lengths.tolist()
    for name, array in one.arrays.items():
        assert (array.dtype, array.tobytes()) == (other[name].dtype, other[name].tobytes()), name


def needs_arrow(ending):
    if ending == ".parquet":
        pytest.importorskip("pyarrow", reason="needs the recordings extra: make installs it")


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_file_gives_back_the_same_bits(ending, tmp_path):
    needs_arrow(ending)
    for one in (recording(), recording()[1], recording()[[]], recording()[2]):
        one.save(tmp_path / f"flights{ending}")
        assert_same(Recording.load(tmp_path / f"flights{ending}"), one)
    getattr(recording(), f"to_{ending[1:]}")(tmp_path / "flights")
    assert (tmp_path / "flights").read_bytes()
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_damaged_file_is_refused_in_one_line(ending, tmp_path):
    needs_arrow(ending)
    path, damaged = tmp_path / f"whole{ending}", tmp_path / f"damaged{ending}"
    recording().save(path)
    content, rng, said = path.read_bytes(), random.Random(0), []
    for number in range(300):
        wrong, place = bytearray(content), rng.randrange(len(content))
        wrong[place] = rng.randrange(256)
        damaged.write_bytes(wrong[:place] if number % 3 == 0 else wrong)
        try:
            Recording.load(damaged)
        except ValueError as error:
            said.append(str(error))
    assert len(said) > 200
    assert all(line.startswith(str(damaged)) and "\n" not in line for line in said)


@pytest.mark.parametrize("ending", ENDINGS)
def test_something_else_is_refused(ending, tmp_path):
    needs_arrow(ending)
    path = tmp_path / f"other{ending}"
    for content in (b"", b"# {}\n", b"PK\x03\x04", b"PAR1PAR1", b"\x93NUMPY"):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"other\.\w+: ") as error:
            Recording.load(path)
        assert "\n" not in str(error.value)
    with pytest.raises(ValueError, match="No such file"):
        Recording.load(tmp_path / f"none{ending}")
    np.savez(tmp_path / "some.npz", a=np.zeros(1), header=np.array([{}], object))
    with pytest.raises(ValueError, match=r"some\.npz: "):
        Recording.load(tmp_path / "some.npz")
    with pytest.raises(ValueError, match=r"must end in \.npz, \.parquet or \.csv, got '\.txt'"):
        recording().save(tmp_path / "a.txt")


def test_a_line_of_text_that_is_wrong_is_named(tmp_path):
    path = tmp_path / "a.csv"
    recording().save(path)
    lines = path.read_text().splitlines()
    for line, wrong, message in (
        (4, lines[4].replace(",", ",x", 3), "line 5: time must be a number of type float64, got 'x"),
        (4, lines[4] + ",1", "line 5 must have 18 entries, got 19"),
        (1, lines[1].replace("duty_1", "duty_9"), "must have the column 'duty_1', got none"),
    ):
        path.write_text("\n".join([*lines[:line], wrong, *lines[line + 1 :]]))
        with pytest.raises(ValueError, match=message):
            Recording.load(path)
    path.write_text("\n".join(lines[:-1]))
    with pytest.raises(ValueError, match="it must have 11 rows, got 10"):
        Recording.load(path)


def test_a_table_has_units_and_a_row_for_each_instant(tmp_path):
    needs_arrow(".parquet")
    from pyarrow import parquet

    recording().save(tmp_path / "a.parquet")
    table = parquet.read_table(tmp_path / "a.parquet")
    assert table.num_rows == 11
    assert table.schema.field("position_2_x").metadata[b"unit"] == b"m"
    assert table.column("step").to_pylist() == [0, 1, 2, 3, 0, 0, 1, 2, 3, 4, 5]
    assert table.column("reward").null_count == 3


def test_episodes_are_taken_out_and_put_together():
    whole = recording()
    assert [len(one.time) for one in whole] == [4, 1, 6]
    assert np.array_equal(whole[2].reward, whole.reward[3:])
    assert np.array_equal(whole[-1].position, whole.position[5:])
    assert whole[whole.terminated].lengths.tolist() == [3, 5]
    assert_same(concatenate(list(whole)), whole)
    assert_same(whole[[2, 0]], concatenate([whole[2], whole[0]]))
    assert whole.fault["kind"].shape == (3, 2)
    assert whole.episode.tolist() == [0] * 4 + [1] + [2] * 6
    assert whole.padded("reward").shape == (3, 5)
    assert np.isnan(whole.padded("reward")[1]).all()
    assert whole.padded("time", fill=0.0)[0, 4:].tolist() == [0.0, 0.0]
    assert np.array_equal(whole.final("observation"), whole.observation[[3, 4, 10]])
    assert np.allclose(whole.returns, [whole.reward[:3].sum(), 0.0, whole.reward[3:].sum()])
    with pytest.raises(ValueError, match="reward has no last entry in an episode without a step"):
        whole.final("reward")


def test_what_differs_between_sources_is_asked_of_an_episode():
    one, other = recording(), recording(({"environment": "x", "orbits": [1.0]},))
    both = concatenate([one, other])
    assert both.metadata == {"environment": "x"}
    assert both[4].metadata["orbits"] == [1.0]
    assert both[:2].metadata == one.metadata
    lacking = Recording(
        {"time": Channel("instant", "s")}, {"time": one.time}, LENGTHS, one.seeds, one.sources
    )
    with pytest.raises(ValueError, match="same channels; number 2 lacks 'position'"):
        concatenate([one, lacking])
    with pytest.raises(ValueError, match="must have at least one"):
        concatenate([])


def test_names_that_are_not_there_are_said():
    with pytest.raises(AttributeError, match="'positon' is not recorded; did you mean 'position'"):
        recording().positon  # noqa: B018
    with pytest.raises(KeyError, match="not recorded"):
        recording()["speed"]
    with pytest.raises(IndexError):
        recording()[3]
    whole = recording()
    with pytest.raises(ValueError, match=r"time must have the shape \(11,\), got \(10,\)"):
        Recording(whole.channels, whole.arrays | {"time": whole.time[1:]}, LENGTHS, whole.seeds)
