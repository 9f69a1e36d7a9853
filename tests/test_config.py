"""One tree of settings: defaults, files, overrides, and every mistake in one line."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml

from snakeslam.config import Config, Override, load_config, override_config, parse_override
from snakeslam.config_file import sim_yaml
from snakeslam.errors import InputError


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "some.yaml"
    path.write_text(text)
    return path


def leaves(tree: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in tree.items():
        found |= leaves(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: value}
    return found


def test_sim_yaml_is_complete_and_equals_the_defaults(checkout: Path) -> None:
    path = checkout / "configs" / "sim.yaml"
    assert load_config(path) == Config()
    assert leaves(yaml.safe_load(path.read_text())) == leaves(Config().model_dump(mode="json"))


def test_the_simulator_starts_stopped_and_with_predictive_head_control(checkout: Path) -> None:
    config = load_config(checkout / "configs" / "sim.yaml")
    assert not config.run.autostart
    assert config.head.controller == "predictive"


def test_sim_yaml_is_what_the_settings_say_of_themselves(checkout: Path) -> None:
    assert (checkout / "configs" / "sim.yaml").read_text() == sim_yaml(), "run make configs"


def test_every_setting_is_documented() -> None:
    for before, line in pairwise(sim_yaml().splitlines()):
        if line.strip() and not line.strip().startswith("#"):
            assert before.strip().startswith("#"), line


@pytest.mark.parametrize("name", ["sim.yaml", "replay.yaml"])
def test_the_configurations_that_come_along_are_valid(checkout: Path, name: str) -> None:
    load_config(checkout / "configs" / name)


CONTRACT = {
    "robot.model": ["sim35", "orthogonal24"],
    "gait.name": ["serpentine", "sidewinding", "arc_rolling", "helix_rolling", "pedal"],
    "gait.alpha_pi": [0.1, 0.3],
    "gait.wavelength_joints": [16, 20],
    "gait.period_s": [4, 2.5],
    "gait.amplitude_deg": [8.6],
    "head.controller": ["none", "direction", "position", "predictive"],
    "head.neck_joints": [4, 6],
    "estimator.mode": ["visual", "vio", "planar", "fused", "gait"],
    "sim.world": ["corridor", "office", "rubble", "blank"],
    "sim.friction_ratio": [3, 10],
    "sim.camera.rate_hz": [10, 20],
    "recording.enabled": ["false", "true"],
}


@pytest.mark.parametrize(("key", "value"), [(key, value) for key, values in CONTRACT.items() for value in values])
def test_the_settings_of_the_contract_can_be_set(key: str, value: object) -> None:
    changed = leaves(load_config(None, [f"{key}={value}"]).model_dump(mode="json"))
    assert changed[key] == {"false": False, "true": True}.get(str(value), value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("gait: {perod_s: 4}", r"some\.yaml: gait\.perod_s: unknown key .* did you mean gait\.period_s\?"),
        (
            "gate: {}",
            r"some\.yaml: gate: unknown key gate, did you mean gait\? \(allowed: backend, estimator, gait, governor",
        ),
        ("gait: {period_s: -4}", r"some\.yaml: gait\.period_s: -4 is not possible \(allowed: >=? ?0"),
        ("gait: {period_s: .nan}", r"gait\.period_s: nan is not possible"),
        ("gait: {period_s: fast}", r"gait\.period_s: 'fast' is not possible \(allowed: a number\)"),
        ("gait: {name: moonwalk}", r"gait\.name: 'moonwalk' is not possible \(allowed: serpentine, sidewinding, "),
        ("run: {seed: 1.5}", r"run\.seed: 1\.5 is not possible \(allowed: a whole number\)"),
        ("run: {duration_s: 0}", r"run\.duration_s: 0 is not possible \(allowed: > 0\)"),
        ("recording: {enabled: perhaps}", r"recording\.enabled: 'perhaps' is not possible \(allowed: true or false\)"),
        ("gait: pedal", r"some\.yaml: gait: 'pedal' is not possible \(allowed: a group\)"),
        ("estimator: {noise: {pixel: 1}}", r"estimator\.noise\.pixel: unknown key .*did you mean .*noise\.pixel_px"),
        ("run:\n  seed: 1\n  seed: 2\n", r"some\.yaml: line 3: the key 'seed' is given twice"),
        ("run: [", r"some\.yaml: line 1: "),
        ("just words", r"some\.yaml: has no keys"),
        ("- 1\n- 2", r"some\.yaml: has no keys"),
        ("\tgait:\n", r"some\.yaml: line 1: "),
        ("run: {seed: 010}", r"run\.seed: '010' is not possible \(allowed: a whole number\)"),
        ("run: {seed: true}", r"run\.seed: True is not possible \(allowed: a whole number\)"),
        ("run: {seed: 2.0}", r"run\.seed: 2\.0 is not possible \(allowed: a whole number\)"),
        ("run: {seed: '3'}", r"run\.seed: '3' is not possible \(allowed: a whole number\)"),
        ("run: {duration_s: yes}", r"run\.duration_s: 'yes' is not possible \(allowed: a number\)"),
        ("run: {duration_s: true}", r"run\.duration_s: True is not possible \(allowed: a number\)"),
        ("run: {duration_s: 1:30}", r"run\.duration_s: '1:30' is not possible \(allowed: a number\)"),
        ("run: {duration_s: 1_0}", r"run\.duration_s: '1_0' is not possible \(allowed: a number\)"),
        ("run: {duration_s: 2024-01-01}", r"run\.duration_s: '2024-01-01' is not possible \(allowed: a number\)"),
        ("run: {duration_s: 1e999}", r"run\.duration_s: inf is not possible"),
        ("recording: {enabled: 1}", r"recording\.enabled: 1 is not possible \(allowed: true or false\)"),
        ("gait: {name: 3}", r"gait\.name: 3 is not possible \(allowed: serpentine"),
        ("replay: {calibration: 3}", r"replay\.calibration: 3 is not possible \(allowed: text\)"),
        ("a: [" + "[" * 500, r"some\.yaml: line 1: is nested too deeply"),
        ("a: *b", r"some\.yaml: line 1: \*b stands for nothing"),
        ("run: !!python/name:os.system", r"line 1: the tag !!python/name:os\.system is not allowed"),
        ("run: {seed: 1}\n---\nrun: {seed: 2}", r"some\.yaml: line 2: a second document"),
    ],
)
def test_a_mistake_in_a_file_is_one_line_with_file_key_value_and_what_is_allowed(
    tmp_path: Path, text: str, expected: str
) -> None:
    with pytest.raises(InputError, match=expected) as caught:
        load_config(write(tmp_path, text))
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("gait.period_s=-1", r"^--set gait\.period_s: -1 is not possible \(allowed: >"),
        ("gait.perod_s=1", r"^--set gait\.perod_s: unknown key .*did you mean gait\.period_s"),
        ("gait=3", r"^--set gait: 3 is not possible \(allowed: a group\)"),
        ("gait.name.x=3", r"^--set gait\.name\.x: "),
        ("world=office", r"^--set world: unknown key world"),
        ("gait.period_s", r"^--set gait\.period_s: is not understood \(allowed: KEY=VALUE"),
        ("=3", r"^--set =3: is not understood"),
        ("gait..name=pedal", r"^--set gait\.\.name=pedal: is not understood"),
        ("gait.name=[", r"^--set gait\.name: the value '\[' is no YAML"),
        ("gait.name=\udc80", r"^--set gait\.name: the value '\\udc80' is no YAML"),
        ("gait.name=" + "[" * 5000, r"^--set gait\.name: .* nested too deeply"),
        ("\udc80=1", r"^--set '\\udc80=1': is not understood"),
    ],
)
def test_a_mistake_in_an_override_names_it(override: str, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        load_config(None, [override])


def test_overrides_win_over_the_file_and_the_last_one_over_the_others(tmp_path: Path) -> None:
    path = write(tmp_path, "run: {seed: 5, duration_s: 7}\ngait:\n")
    config = load_config(path, ["run.seed=6", Override("run.seed", 8, "--seed")])
    assert (config.run.seed, config.run.duration_s) == (8, 7.0)


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ("run.seed=1", "run.seed=2", r"^--set run\.seed: is given twice"),
        ("run.seed=1", "run.seed=1", r"^--set run\.seed: is given twice"),
        ("gait.name=pedal", "gait={period_s: 4}", r"^--set gait: overlaps --set gait\.name"),
        ("gait={period_s: 4}", "gait.period_s=5", r"^--set gait\.period_s: overlaps --set gait"),
    ],
)
def test_a_setting_given_twice_is_refused_instead_of_the_last_one_winning(
    first: str, second: str, expected: str
) -> None:
    with pytest.raises(InputError, match=expected):
        load_config(None, [first, second])


@pytest.mark.parametrize(
    ("word", "value"), [("yes", True), ("on", True), ("no", False), ("Off", False), ("true", True)]
)
def test_the_words_for_true_and_false_are_those_only_where_one_of_them_is_wanted(word: str, value: bool) -> None:
    assert load_config(None, [f"recording.enabled={word}"]).recording.enabled is value


def test_an_override_on_a_broken_file_names_the_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"some\.yaml: gait\.period_s"):
        load_config(write(tmp_path, "gait: {period_s: -4}"), ["gait.name=pedal"])


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 0.001),
        ("off", "off"),
        ("010", "010"),
        ("1:30", "1:30"),
        ("true", True),
        ("null", None),
        ("", None),
        ("[1, 2]", [1, 2]),
        ("a=b", "a=b"),
    ],
)
def test_override_values_are_yaml(text: str, value: object) -> None:
    assert parse_override(f"a.b={text}") == Override("a.b", value, "--set a.b")


def test_a_configuration_in_use_can_be_changed() -> None:
    config = load_config(None, ["run.seed=4"])
    changed = override_config(config, [Override("gait.name", "pedal", "overrides.gait.name")])
    assert (changed.run.seed, changed.gait.name) == (4, "pedal")
    assert config.gait.name == "serpentine"
    with pytest.raises(InputError, match=r"^overrides\.gait\.name: 'walk'"):
        override_config(config, [Override("gait.name", "walk", "overrides.gait.name")])


def test_missing_and_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.yaml: no such configuration file"):
        load_config(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="Is a directory"):
        load_config(tmp_path)
    (tmp_path / "b.yaml").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="not a text file"):
        load_config(tmp_path / "b.yaml")


def test_settings_cannot_be_changed_afterwards() -> None:
    with pytest.raises(ValueError, match="frozen"):
        load_config().run.seed = 3  # type: ignore[misc]
