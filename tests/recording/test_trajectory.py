"""TUM trajectory files."""

from pathlib import Path

import numpy as np
import pytest

from snakeslam.errors import InputError
from snakeslam.geometry import se3, so3
from snakeslam.recording.tables import stamp_from_s
from snakeslam.recording.trajectory import format_trajectory, read_trajectory, write_trajectory


def test_a_trajectory_survives_the_file_with_exact_stamps(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    stamps = [1403715285262142976, 1403715285262142977, 1403715286000000001]
    poses = se3.exp(rng.normal(size=(3, 6)))
    write_trajectory(tmp_path / "a.tum", zip(stamps, poses, strict=True))
    t_ns, Ts = read_trajectory(tmp_path / "a.tum")
    assert t_ns.tolist() == stamps
    np.testing.assert_allclose(Ts, poses, atol=3e-9)


def test_the_format_is_tums_with_nine_decimals() -> None:
    T = se3.from_rt(so3.exp(np.array([0.0, 0.0, np.pi / 2])), [1.0, -2.0, 0.5])
    line = format_trajectory([(1_000_000_005, T)]).splitlines()[1]
    assert line == ("1.000000005 1.000000000 -2.000000000 0.500000000 0.000000000 0.000000000 0.707106781 0.707106781")


@pytest.mark.parametrize(
    ("text", "t_ns"),
    [
        ("1305031229.528748", 1305031229528748000),
        ("0.1", 100_000_000),
        ("7", 7_000_000_000),
        ("1.0000000014", 1000000001),
        ("1e9", 10**18),
        ("+1.305031228533100128e+09", 1305031228533100128),
        (".5", 500_000_000),
    ],
)
def test_seconds_become_exact_nanoseconds(text: str, t_ns: int) -> None:
    assert stamp_from_s(text) == t_ns


@pytest.mark.parametrize(
    "text", ["nan", "inf", "-1.0", "1e10", "1e999999999", "", "1,5", "1_0", "12345678901", "9" * 99]
)
def test_no_time_is_no_stamp(text: str) -> None:
    with pytest.raises(ValueError, match="timestamp"):
        stamp_from_s(text)


def test_a_broken_row_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.tum").write_text("# t x\n1.0 0 0 0 0 0 0 1\n2.0 0 0 0 0 0 0 0\n")
    with pytest.raises(InputError, match=r"a\.tum: line 3: the quaternion"):
        read_trajectory(tmp_path / "a.tum")
