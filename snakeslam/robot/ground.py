"""Where a body of known shape touches level ground, and how heavily: static levelling on a soft skin.

The heights of the links alone do not say it: half a degree over a metre is 9 mm. So the plane is found that bears the
weight under the centre of mass, on a skin that gives by some millimetres: a convex problem with three unknowns.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry import so3
from snakeslam.geometry.compiled import compiled
from snakeslam.messages import Float
from snakeslam.robot.model import SnakeModel

GRAVITY_M_S2 = 9.81
SKIN_GIVES_M = 0.003
"""How far the skin gives under the mean load of those that bear; it also stands for what the joints give."""
FEWEST = 6.0
ROUNDS = 20
PLANES = 2
HALVINGS = 8
ENOUGH_M = 1e-7
X_AXIS, Y_AXIS = np.eye(3)[:2]


@dataclass(frozen=True, slots=True)
class Ground:
    """The plane under a body: ``normal_I`` (3,) out of it, ``contacts_I`` (M, 3) the points of the skin nearest to it,
    ``loads_n`` (M,) what they bear, ``link`` (M,) whose they are; two contacts for each link, loaded or not.
    """

    normal_I: Float
    contacts_I: Float
    loads_n: Float
    link: NDArray[np.int64]

    @property
    def height_m(self) -> float:
        """How far the origin of I is over the plane."""
        return -float(self.loads_n @ self.contacts_I @ self.normal_I / self.loads_n.sum())


def level(model: SnakeModel, Ts_IL: Float, up_I: Float) -> Ground:
    """Return the ground under the links ``Ts_IL`` (N + 1, 4, 4), near the upward direction ``up_I`` (3,).

    Minimises 1/2 k sum max(0, pen)^2 - m g (height of the plane at the centre of mass) by Newton's method; a straight
    body, which could roll freely, stays as ``up_I`` says.
    """
    spheres = Ts_IL[:, None, :3, 3] + np.einsum("nij,sj->nsi", Ts_IL[:, :3, :3], model.sphere_centres_L)
    centres_I = spheres.reshape(-1, 3)
    masses = model.link_masses_kg
    com_I = masses @ (Ts_IL[:, :3, 3] + Ts_IL[:, :3, :3] @ model.com_L) / masses.sum()
    weight_n = float(masses.sum()) * GRAVITY_M_S2
    normal = up_I / np.linalg.norm(up_I)
    loads = np.ones(len(centres_I))
    for _ in range(PLANES):
        stiff = weight_n / (_bearing(loads) * SKIN_GIVES_M)
        loads, normal = _plane(centres_I - com_I, normal, model.radius_m, weight_n, stiff)
    link = np.repeat(np.arange(model.link_count), model.sphere_centres_L.shape[0])
    return Ground(normal, centres_I - model.radius_m * normal, loads, link)


def _bearing(loads: Float) -> float:
    """Return how many contacts bear, in effect."""
    return max(FEWEST, float(loads.sum() ** 2 / (loads @ loads)))


def _plane(points: Float, up: Float, radius_m: float, weight_n: float, stiff: float) -> tuple[Float, Float]:
    """Return the loads of spheres at ``points`` about the centre of mass, and the plane's normal."""
    side = so3.cross(up, X_AXIS if abs(up[0]) < 0.9 else Y_AXIS)
    side /= np.linalg.norm(side)
    frame = np.stack([side, so3.cross(up, side), up])
    x, y, z = frame @ points.T
    plane, pen = _settle(x, y, z - radius_m, weight_n, weight_n * radius_m, stiff)
    normal = frame.T @ np.array([-plane[1], -plane[2], 1.0])
    return stiff * np.maximum(pen, 0.0), normal / np.linalg.norm(normal)


@compiled
def _settle(x: Float, y: Float, lowest: Float, weight_n: float, hold_nm: float, stiff: float) -> tuple[Float, Float]:
    """Return the plane (height, slopes) that bears the weight, and how deep each sphere is in it, (M,).

    From deep down, where every contact bears, Newton's steps come up without leaving any out too early.
    """
    plane: Float = np.array([np.max(lowest) + SKIN_GIVES_M, 0.0, 0.0])
    pen = _penetration(plane, x, y, lowest)
    for _ in range(ROUNDS):
        bend, gradient = np.diag(np.array([0.0, hold_nm, hold_nm])) + 1e-6 * np.eye(3), np.zeros(3)
        gradient[0], gradient[1], gradient[2] = -weight_n, hold_nm * plane[1], hold_nm * plane[2]
        for c in range(len(x)):
            if pen[c] > 0.0:
                row = (1.0, x[c], y[c])
                for i in range(3):
                    gradient[i] += stiff * pen[c] * row[i]
                    for j in range(3):
                        bend[i, j] += stiff * row[i] * row[j]
        step = np.linalg.solve(bend, -gradient).astype(np.float64)
        # Halved until the energy falls.
        before = _energy(plane, pen, weight_n, hold_nm, stiff)
        trial = plane + step
        deep = _penetration(trial, x, y, lowest)
        for _ in range(HALVINGS):
            if _energy(trial, deep, weight_n, hold_nm, stiff) <= before:
                break
            step = step / 2.0
            trial = plane + step
            deep = _penetration(trial, x, y, lowest)
        moved = np.max(np.abs(deep - pen))
        plane, pen = trial, deep
        if moved < ENOUGH_M:
            break
    return plane, pen


@compiled
def _penetration(plane: Float, x: Float, y: Float, lowest: Float) -> Float:
    return plane[0] + plane[1] * x + plane[2] * y - lowest


@compiled
def _energy(plane: Float, pen: Float, weight_n: float, hold_nm: float, stiff: float) -> float:
    held = 0.5 * hold_nm * (plane[1] ** 2 + plane[2] ** 2) - weight_n * plane[0]
    for deep in pen:
        if deep > 0.0:
            held += 0.5 * stiff * deep * deep
    return held
