"""Where a body of known shape touches level ground, and how heavily: static levelling on a soft skin.

The heights of the links alone do not say it: half a degree over a metre is 9 mm. So the plane is found that bears the
weight under the centre of mass, on a skin that gives by some millimetres: a convex problem with three unknowns.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snakeslam.messages import Float
from snakeslam.robot.model import SnakeModel

GRAVITY_M_S2 = 9.81
SKIN_GIVES_M = 0.003
"""How far the skin gives under the mean load of those that bear; it also stands for what the joints give."""
FEWEST = 6.0
ROUNDS = 20
PLANES = 2
ENOUGH_M = 1e-7


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
    side = np.cross(up, [1.0, 0.0, 0.0] if abs(up[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    frame = np.stack([side, np.cross(up, side), up])
    x, y, z = frame @ points.T
    rows = np.stack([np.ones_like(x), x, y], axis=1)
    hold = np.diag([0.0, 1.0, 1.0]) * weight_n * radius_m
    load = np.array([weight_n, 0.0, 0.0])
    # From deep down, where every contact bears, Newton's steps come up without leaving any out too early.
    plane = np.array([float(np.max(z)) - radius_m + SKIN_GIVES_M, 0.0, 0.0])
    pen = rows @ plane - (z - radius_m)
    for _ in range(ROUNDS):
        active = rows[pen > 0.0]
        gradient = stiff * rows.T @ np.maximum(pen, 0.0) + hold @ plane - load
        step = np.linalg.solve(stiff * active.T @ active + hold + 1e-6 * np.eye(3), -gradient)
        plane, pen = _descend(plane, step, rows, z - radius_m, stiff, hold, load)
        if np.max(np.abs(rows @ step)) < ENOUGH_M:
            break
    normal = frame.T @ np.array([-plane[1], -plane[2], 1.0])
    return stiff * np.maximum(pen, 0.0), normal / np.linalg.norm(normal)


def _descend(
    plane: Float, step: Float, rows: Float, lowest: Float, stiff: float, hold: Float, load: Float
) -> tuple[Float, Float]:
    """Take the step, halved until the energy falls."""

    def energy(x: Float, pen: Float) -> float:
        return float(0.5 * stiff * np.sum(np.maximum(pen, 0.0) ** 2) + 0.5 * x @ hold @ x - load @ x)

    before = energy(plane, rows @ plane - lowest)
    for _ in range(8):
        trial = plane + step
        pen = rows @ trial - lowest
        if energy(trial, pen) <= before:
            return trial, pen
        step = step / 2.0
    return plane, rows @ plane - lowest
