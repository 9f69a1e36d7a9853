"""The simulator in the registry of backends; it is loaded when it is opened, and may not be installed."""

from typing import TYPE_CHECKING

from snakeslam.backends.kind import BackendKind, BackendRequest
from snakeslam.backends.sim.settings import SimSettings
from snakeslam.errors import InputError

if TYPE_CHECKING:
    from snakeslam.backends.base import Backend, FrameSource


def _open(request: BackendRequest[SimSettings]) -> "Backend":
    try:
        from snakeslam.backends.sim.backend import SimBackend
    except ModuleNotFoundError as error:
        raise _not_installed(error) from error
    return SimBackend(request.model, request.settings, request.seed, request.camera)


def _open_camera(request: BackendRequest[SimSettings]) -> "FrameSource":
    try:
        from snakeslam.backends.sim.scene import SceneCamera
    except ModuleNotFoundError as error:
        raise _not_installed(error) from error
    return SceneCamera(request.model, request.settings, request.seed)


def _not_installed(error: ModuleNotFoundError) -> InputError:
    return InputError("the simulator", f"{error.name} is not installed", "Python 3.11 with the extra 'sim'")


SIM = BackendKind("sim", "the simulator, settings under sim:", "sim", _open, _open_camera)
