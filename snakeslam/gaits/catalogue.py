"""All gaits there are, found in ``forms``, and the settings and resolution that follow from them."""

from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, create_model

from snakeslam.gaits import forms
from snakeslam.gaits.gait import Gait, ResolvedGait, resolve_values
from snakeslam.gaits.parameters import PERIOD, ParameterKind
from snakeslam.robot.model import SnakeModel
from snakeslam.settings import Settings


def _find() -> dict[str, Gait]:
    """Return the gaits of ``forms`` by name, in the page's order."""
    modules = [import_module(f"{forms.__name__}.{module.name}") for module in iter_modules(forms.__path__)]
    gaits: list[Gait] = [module.GAIT for module in modules]
    return {gait.name: gait for gait in sorted(gaits, key=lambda gait: (gait.rank, gait.name))}


def _kinds(gaits: Iterable[Gait]) -> dict[str, ParameterKind]:
    """Return the kinds of parameters that ``gaits`` have, by key; one key may not mean two things."""
    kinds: dict[str, ParameterKind] = {}
    for gait in gaits:
        own = [*(parameter.kind for parameter in gait.parameters), *(kind for kind, _ in gait.substitutes)]
        if PERIOD not in own:
            raise TypeError(f"the gait {gait.name} has no {PERIOD.key}")
        for kind in own:
            if kinds.setdefault(kind.key, kind) != kind:
                raise TypeError(f"the gait {gait.name} defines {kind.key} otherwise than another gait")
    return kinds


GAITS: Mapping[str, Gait] = _find()
PARAMETER_KINDS: Mapping[str, ParameterKind] = _kinds(GAITS.values())
DEFAULT_GAIT = next(iter(GAITS))

if TYPE_CHECKING:
    GaitName = str
else:
    GaitName = Literal[tuple(GAITS)]


def name_list(names: Sequence[str], last: str = "or") -> str:
    """Return names as a list in words: a, b or c."""
    *others, final = names or ("no gait",)
    return f"{', '.join(others)} {last} {final}" if others else final


class GaitChoice(Settings):
    """Which gait, and its parameters: null takes the gait's own default, and one that it does not have is ignored."""

    name: Annotated[GaitName, Field(description=f"{name_list(tuple(GAITS))}.")] = DEFAULT_GAIT

    def given(self) -> dict[str, float]:
        """Return the parameters that are set, by key."""
        values = {key: getattr(self, key) for key in PARAMETER_KINDS}
        return {key: value for key, value in values.items() if value is not None}


def _setting(kind: ParameterKind) -> tuple[Any, Any]:
    """Return the type and the field of one parameter in the settings."""
    number: Any = Annotated[float, Field(ge=kind.least, le=kind.most)]
    return number | None, Field(default=None, description=f"{kind.text} ({_who_has(kind)}).")


def _who_has(kind: ParameterKind) -> str:
    """Return which gaits have a parameter, in words."""
    having = [gait.name for gait in GAITS.values() if kind in (parameter.kind for parameter in gait.parameters)]
    instead = [
        f"{gait.name}: instead of {replaced}"
        for gait in GAITS.values()
        for substitute, replaced in gait.substitutes
        if substitute == kind
    ]
    directly = "all gaits" if len(having) == len(GAITS) else ", ".join(having)
    return "; ".join(filter(None, [directly, *instead]))


if TYPE_CHECKING:
    GaitSettings = GaitChoice
else:
    GaitSettings = create_model(
        "GaitSettings",
        __base__=GaitChoice,
        __module__=__name__,
        __doc__=GaitChoice.__doc__,
        **{key: _setting(kind) for key, kind in PARAMETER_KINDS.items()},
    )


def resolve(settings: GaitSettings, model: SnakeModel, turn: float = 0.0) -> ResolvedGait:
    """Return the gait with its defaults filled in and ``turn`` in [-1, 1] (positive to the left) applied.

    Raises InputError where the joints cannot do it.
    """
    return resolve_values(GAITS[settings.name], settings.given(), model, turn)
