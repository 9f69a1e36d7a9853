"""One validated tree of settings; each package's part is defined beside its consumer and composed here."""

import difflib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, ValidationError
from pydantic_core import ErrorDetails

from snakeslam.backends.registry import BACKENDS, BackendName
from snakeslam.backends.sim.settings import SimSettings
from snakeslam.errors import InputError
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.gaits.catalogue import GaitSettings
from snakeslam.head.settings import HeadSettings
from snakeslam.mapping.settings import MappingSettings
from snakeslam.recording.settings import ReplaySettings
from snakeslam.robot.settings import RobotSettings
from snakeslam.settings import Settings
from snakeslam.yaml_reader import parse_yaml, read_yaml

FLAGS = {"yes": True, "on": True, "no": False, "off": False}
"""Words that many write for true and false; they are text where text is wanted."""


class RecordingSettings(Settings):
    """What is written besides trajectories."""

    enabled: bool = False
    """Write sensors/ into the run directory: a TUM RGB-D folder with IMU and joints, which snakeslam replay reads."""


class RunSettings(Settings):
    """A scripted run."""

    seed: Annotated[int, Field(ge=0, lt=2**32)] = 1
    """Seed of everything random: the world, the sensors' noise, the estimator."""
    duration_s: Annotated[float, Field(gt=0, le=86400)] = 20.0
    """Simulated time; a recording is played to its end when ``replay`` is given no duration."""
    rest_s: Annotated[float, Field(ge=0, le=60)] = 0.5
    """The robot lies still for so long before it starts, so that the estimator can find gravity."""
    autostart: bool = False
    """The dashboard's simulator starts its gait by itself, with nobody in control; a scripted run always does."""


class GovernorSettings(Settings):
    """When the governor slows the gait, and how far."""

    enabled: bool = False
    """Slow the gait while the estimator is in trouble."""
    least_pace: Annotated[float, Field(gt=0, le=1)] = 0.35
    """Least share of the commanded pace: with none the robot would never leave a place where it sees nothing."""
    enough_tracks: Annotated[int, Field(ge=1)] = 60
    """With this many tracked features, or more, the pace is not reduced."""
    few_tracks: Annotated[int, Field(ge=0)] = 20
    """With this few the gait moves at its least pace."""
    fine_innovation: Annotated[float, Field(gt=0)] = 2.0
    """Squared innovations up to this multiple of their prediction (the median) do not reduce the pace."""
    bad_innovation: Annotated[float, Field(gt=0)] = 6.0
    """From this multiple on the gait moves at its least pace."""
    fall_per_s: Annotated[float, Field(gt=0)] = 2.0
    """Rate at which the pace is reduced, per second."""
    rise_per_s: Annotated[float, Field(gt=0)] = 0.25
    """Rate at which the pace is restored, per second."""
    good_s: Annotated[float, Field(ge=0)] = 1.0
    """The pace is restored once more has been allowed for so long, in seconds."""


class SafetySettings(Settings):
    """When a moving robot without support from the camera is stopped, and how it backs up."""

    max_blind_s: Annotated[float, Field(ge=0, le=3600)] = 5.0
    """Seconds without support from the camera after which a moving robot is held, until an operator starts it again or
    has it back up; 0: never. A scripted run has no operator: it goes on."""
    back_up_s: Annotated[float, Field(gt=0, le=60)] = 4.0
    """A back-up plays the gait backwards for so many seconds, however blind the robot is, and then stops."""


class ServerConfig(Settings):
    """The dashboard's server."""

    state_dir: str | None = None
    """Folder of what outlives the server (who is signed in); null: snakeslam below $XDG_STATE_HOME, ~/.local/state
    without."""
    session_hours: Annotated[float, Field(gt=0, le=24 * 365)] = 12.0
    """A browser stays signed in for so long."""
    hosts: tuple[str, ...] = ()
    """Names by which browsers may reach it, besides localhost, this machine's name and its name with .local;
    "*.example.com" allows every name below example.com."""
    trusted_proxies: tuple[str, ...] = ()
    """Addresses or networks of TLS front ends whose X-Forwarded-For and X-Forwarded-Proto are believed."""


def _backends() -> str:
    """Return what the backends are, for the settings' text."""
    return (
        f"Where sensors come from and joint targets go: {', '.join(f'{b.name} ({b.text})' for b in BACKENDS.values())}."
    )


class Config(Settings):
    """All settings of a session."""

    backend: Annotated[BackendName, Field(description=_backends())] = "sim"
    robot: RobotSettings = RobotSettings()
    gait: GaitSettings = GaitSettings()
    head: HeadSettings = HeadSettings()
    estimator: EstimatorSettings = EstimatorSettings()
    mapping: MappingSettings = MappingSettings()
    governor: GovernorSettings = GovernorSettings()
    safety: SafetySettings = SafetySettings()
    sim: SimSettings = SimSettings()
    replay: ReplaySettings = ReplaySettings()
    recording: RecordingSettings = RecordingSettings()
    run: RunSettings = RunSettings()
    server: ServerConfig = ServerConfig()


@dataclass(frozen=True, slots=True)
class Override:
    """One setting given beside the file; ``label`` is what an error calls it."""

    key: str
    value: object
    label: str


def parse_override(text: str) -> Override:
    """Return the override of ``KEY=VALUE``, the value read as YAML; InputError when it has another form."""
    key, equals, value = text.partition("=")
    key = key.strip()
    if not equals or not all(key.split(".")) or not key.isprintable():
        raise InputError(
            f"--set {text}" if text.isprintable() else f"--set {text[:60]!r}",
            "is not understood",
            "KEY=VALUE, such as gait.period_s=4",
        )
    try:
        return Override(key, parse_yaml(value, "value"), f"--set {key}")
    except InputError as error:
        shown = repr(value) if len(value) <= 60 else repr(value[:57]) + "..."
        raise InputError(f"--set {key}", f"the value {shown} is no YAML: {error.problem}", error.allowed) from error


def load_config(path: Path | None = None, overrides: Sequence[str | Override] = ()) -> Config:
    """Return the settings of ``path`` (the defaults without one) with ``overrides`` on top.

    InputError names the file (or --set), the key, the value and what is allowed.
    """
    return _build({} if path is None else read_tree(path), overrides, path)


def override_config(config: Config, overrides: Sequence[str | Override]) -> Config:
    """Return ``config`` with ``overrides`` on top; errors as in ``load_config``."""
    return _build(config.model_dump(mode="json"), overrides, None)


def _build(tree: dict[str, Any], overrides: Sequence[str | Override], path: Path | None) -> Config:
    """Validate ``tree`` from ``path`` with ``overrides`` on top."""
    labels: dict[str, str] = {}
    _expand_robot(tree)
    for override in overrides:
        parsed = parse_override(override) if isinstance(override, str) else override
        _refuse_second(parsed, labels)
        _set(tree, parsed)
        labels[parsed.key] = parsed.label

    _expand_robot(tree)

    def where(key: str) -> str:
        label = next((labels[k] for k in labels if f"{k}.".startswith(f"{key}.") or key.startswith(f"{k}.")), None)
        return label if label is not None else f"{path}: {key}" if path is not None else key

    try:
        return _validated(tree)
    except ValidationError as error:
        raise input_error(error.errors()[0], where) from error


def _expand_robot(tree: dict[str, Any]) -> None:
    """Turn a robot's name into a group of this preset, of which overrides may change numbers."""
    if isinstance(tree.get("robot"), str):
        tree["robot"] = {"model": tree["robot"]}


def _validated(tree: dict[str, Any]) -> Config:
    """Return the settings of ``tree``; a value of another type than the setting's is refused, never converted."""
    _read_flags(tree, Config)
    # In JSON a list is a tuple's form and a mapping a group's; in Python strict validation would refuse both.
    return Config.model_validate_json(json.dumps(tree), strict=True)


def _read_flags(tree: dict[str, Any], group: type[BaseModel]) -> None:
    """Turn yes, no, on and off into true and false where the setting is one of these, and nowhere else."""
    for name, info in group.model_fields.items():
        value, kind = tree.get(name), info.annotation
        if kind is bool and isinstance(value, str):
            tree[name] = FLAGS.get(value.lower(), value)
        elif isinstance(value, dict) and isinstance(kind, type) and issubclass(kind, BaseModel):
            _read_flags(value, kind)


def _refuse_second(override: Override, labels: dict[str, str]) -> None:
    """Refuse a setting that is given twice in the same way, or as a whole and in part: the last would win silently.

    Options of their own such as --seed come after --set and win over it.
    """
    key = override.key
    for known, label in labels.items():
        overlaps = f"{known}.".startswith(f"{key}.") or key.startswith(f"{known}.")
        if overlaps and label.removesuffix(known) == override.label.removesuffix(key):
            problem = "is given twice" if known == key else f"overlaps {label}"
            raise InputError(override.label, problem, "each setting once")


def read_tree(path: Path) -> dict[str, Any]:
    """Read a YAML file of groups; a group with nothing in it counts as left out."""
    try:
        tree = read_yaml(path)
    except FileNotFoundError as error:
        raise InputError(str(path), "no such configuration file") from error
    if tree is None:
        return {}
    if not isinstance(tree, dict):
        raise InputError(str(path), "has no keys", "groups such as gait: and sim:")
    return {key: value for key, value in tree.items() if value is not None}


def _set(tree: dict[str, Any], override: Override) -> None:
    """Set a dotted key in ``tree``."""
    *groups, last = override.key.split(".")
    for name in groups:
        inner = tree.setdefault(name, {})
        if not isinstance(inner, dict):
            raise InputError(override.label, f"{name} is a value, not a group")
        tree = inner
    if isinstance(override.value, str) and not override.value.isprintable():
        raise InputError(override.label, f"{override.value[:40]!r} is not possible", "text that can be printed")
    tree[last] = override.value


def input_error(error: ErrorDetails, where: Callable[[str], str]) -> InputError:
    """Turn pydantic's first complaint into one line."""
    key = ".".join(str(part) for part in error["loc"])
    if error["type"] == "extra_forbidden":
        return _unknown_key(error["loc"], where(key))
    value = repr(error["input"])
    value = value if len(value) <= 60 else value[:57] + "..."
    return InputError(where(key), f"{value} is not possible", _allowed(error))


def _allowed(error: ErrorDetails) -> str:
    """Say what a value may be."""
    signs = {"greater_than": ("gt", ">"), "greater_than_equal": ("ge", ">=")}
    signs |= {"less_than": ("lt", "<"), "less_than_equal": ("le", "<=")}
    kind, context = error["type"], error.get("ctx", {})
    if kind in signs:
        name, sign = signs[kind]
        return f"{sign} {context[name]:g}"
    if kind == "literal_error":
        return str(context["expected"]).replace("'", "").replace(" or ", ", ")
    words = {
        "float": "a number",
        "int": "a whole number",
        "bool": "true or false",
        "string": "text",
        "model": "a group",
    }
    word = next((word for prefix, word in words.items() if kind.startswith(prefix + "_")), None)
    return word or ("a finite number" if kind == "finite_number" else " ".join(error["msg"].split()))


def _unknown_key(location: tuple[int | str, ...], where: str) -> InputError:
    """Name the known key nearest to an unknown one, and all that its group has."""
    group: Any = Config
    for part in location[:-1]:
        group = group.model_fields[str(part)].annotation
    known = sorted(group.model_fields)
    prefix = "".join(f"{part}." for part in location[:-1])
    close = difflib.get_close_matches(str(location[-1]), known, n=1, cutoff=0.6)
    hint = f", did you mean {prefix}{close[0]}?" if close else ""
    return InputError(where, f"unknown key {prefix}{location[-1]}{hint}", ", ".join(prefix + name for name in known))
