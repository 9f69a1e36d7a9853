"""A robot is a document: a preset's name, or numbers; 8 to 64 joints, each checked in one line."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from snakeslam.config import load_config
from snakeslam.errors import InputError
from snakeslam.recording.datasets.session import read_session, write_session
from snakeslam.robot.model import PRESETS, robot_document, snake_model
from snakeslam.robot.settings import RobotSettings
from snakeslam.runtime.bus.codec import decode, encode
from snakeslam.studies.experiment import run_experiment

DOCUMENT = """
robot:
  joint_count: 8
  link_length_m: 0.075
  radius_m: 0.025
  link_mass_kg: 0.15
  position_limit_deg: 90
  rate_limit_rad_s: 5
  acceleration_limit_rad_s2: 30
  torque_nm: 3
  head_posture: flat
  head: {camera_m: [0.01, 0.0, 0.02], camera_tilt_deg: 10, imu_m: [-0.03, 0.005, 0.0]}
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "robot.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", PRESETS)
def test_a_presets_name_is_a_robot(tmp_path: Path, name: str) -> None:
    by_name = load_config(write(tmp_path, f"robot: {name}"))
    assert by_name.robot == load_config(None, [f"robot.model={name}"]).robot
    assert by_name.robot == load_config(None, [f"robot={name}"]).robot
    assert snake_model(by_name.robot) == PRESETS[name]
    assert load_config(write(tmp_path, f"robot: {name}"), ["robot.head_posture=flat"]).robot.head_posture == "flat"


def test_the_numbers_are_those_of_the_model(tmp_path: Path) -> None:
    model = snake_model(load_config(write(tmp_path, DOCUMENT)).robot)
    assert (model.name, model.joint_count, model.joint_length_m, model.radius_m) == ("snake8", 8, 0.075, 0.025)
    assert (model.link_mass_kg, model.torque_nm, model.head_posture) == (0.15, 3.0, "flat")
    assert model.limits.position_rad == np.deg2rad(90)
    assert (model.limits.rate_rad_s, model.limits.acceleration_rad_s2) == (5.0, 30.0)
    np.testing.assert_allclose(model.T_HI[:3, 3], [0.045, 0.005, 0.0])
    np.testing.assert_allclose(model.T_HC[:3, 3], [0.085, 0.0, 0.02])
    np.testing.assert_allclose(model.T_HC[:3, 2], [np.cos(np.deg2rad(10)), 0.0, np.sin(np.deg2rad(10))])
    assert 'name="snake8"' in model.urdf()
    assert model.urdf().count("<joint ") == 8


def test_a_number_changes_a_preset_and_nothing_else() -> None:
    changed = snake_model(load_config(None, ["robot.model=orthogonal24", "robot.link_mass_kg=0.3"]).robot)
    assert replace(changed, link_mass_kg=0.22, name="orthogonal24") == PRESETS["orthogonal24"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("robot: walker", r"robot\.yaml: robot\.model: 'walker' is not possible \(allowed: sim35, orthogonal24\)"),
        ("robot: {joint_count: 4}", r"robot\.yaml: robot\.joint_count: 4 is not possible \(allowed: >= 8\)"),
        ("robot: {joint_count: 8.5}", r"robot\.joint_count: 8\.5 is not possible \(allowed: a whole number\)"),
        ("robot: {link_lenght_m: 0.1}", r"robot\.link_lenght_m: unknown key .*did you mean robot\.link_length_m\?"),
        ("robot: {head: {camera_m: [0, 0]}}", r"robot\.head\.camera_m"),
        ("robot: {head: {imu_m: [0, 0, 2]}}", r"robot\.head\.imu_m\.2: 2 is not possible \(allowed: <= 0\.5\)"),
        ("robot: {position_limit_deg: .inf}", r"robot\.position_limit_deg: inf is not possible"),
        ("robot: 35", r"robot: 35 is not possible"),
    ],
)
def test_a_mistake_is_one_line(tmp_path: Path, text: str, expected: str) -> None:
    with pytest.raises(InputError, match=expected) as caught:
        load_config(write(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_a_body_that_is_thicker_than_its_links_are_long_is_refused() -> None:
    with pytest.raises(InputError, match=r"robot\.radius_m: 0\.1 is not possible \(allowed: < 0\.08995\)"):
        snake_model(load_config(None, ["robot.radius_m=0.1"]).robot)


def test_a_document_outlives_a_file_and_the_bus(tmp_path: Path) -> None:
    settings = load_config(write(tmp_path, DOCUMENT)).robot
    assert decode(RobotSettings, encode(settings)) == settings
    model = snake_model(settings)
    write_session(tmp_path / "session.yaml", model, 3)
    facts = read_session(tmp_path)
    assert facts.robot is not None
    again = snake_model(facts.robot)
    np.testing.assert_allclose(again.limits.position_rad, model.limits.position_rad)
    assert replace(again, limits=model.limits, camera_tilt_rad=model.camera_tilt_rad) == model


@pytest.mark.parametrize("preset", PRESETS.values(), ids=lambda preset: preset.name)
def test_a_preset_is_described_by_its_name(preset: object) -> None:
    assert robot_document(preset) == RobotSettings(model=preset.name)  # type: ignore[arg-type, attr-defined]


@pytest.mark.parametrize("joints", [8, 16, 24, 35])
def test_robots_of_8_to_35_joints_run(tmp_path: Path, joints: int) -> None:
    """The default gait with head control, camera and estimator, 3 s of it."""
    settings = [f"robot.joint_count={joints}", "sim.world=office", "gait.period_s=3", "run.rest_s=0.3"]
    result = run_experiment(load_config(None, settings), duration_s=3.0, out=tmp_path / "run")
    assert result.metrics.frames == 60
    assert result.metrics.tracked_fraction is not None
    assert result.metrics.tracked_fraction > 0.8
    rows = np.loadtxt(result.out / "joints.csv", delimiter=",", skiprows=1)
    assert np.isfinite(rows[:, : 1 + joints]).all()
    assert np.ptp(rows[:, 1 : 1 + joints], axis=0).max() > 0.2, "its joints move"


def test_no_place_counts_the_joints_of_the_presets() -> None:
    """Lengths come from the model; a literal count in the package would be one robot's."""
    root = Path(__file__).parents[2] / "snakeslam"
    for path in root.rglob("*.py"):
        if path.name in ("model.py", "settings.py") and path.parent.name == "robot":
            continue
        assert not re.search(r"\b(joint_count|joints)\s*==\s*\d", path.read_text()), path
