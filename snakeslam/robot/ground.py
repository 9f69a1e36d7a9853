"""Where a body of known shape touches level ground, and how heavily: static levelling on a soft skin.

The heights of the links do not determine it, because half a degree over a metre is 9 mm. So the plane is found that
carries the weight under the centre of mass, on a skin that is compressed by some millimetres: a convex problem with
three unknowns.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry.compiled import compiled
from snakeslam.geometry.so3 import cross_of_two
from snakeslam.messages import Float
from snakeslam.robot.model import SnakeModel

GRAVITY_M_S2 = 9.81
SKIN_GIVES_M = 0.003
"""Compression of the skin under the mean load of the loaded contacts; it also stands for the joints' compliance."""
FEWEST = 6.0
ROUNDS = 20
PLANES = 2
HALVINGS = 8
ENOUGH_M = 1e-7
X_AXIS, Y_AXIS = np.eye(3)[:2]


@dataclass(frozen=True, slots=True)
class Ground:
    """The plane under a body: ``normal_I`` (3,) out of it, ``contacts_I`` (M, 3) the points of the skin nearest to it,
    ``loads_n`` (M,) their loads, ``link`` (M,) the link of each; two contacts for each link, loaded or not.
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
    centres_I, com_I = _spheres(Ts_IL, model.sphere_centres_L, model.link_masses_kg, model.com_L)
    weight_n = float(model.link_masses_kg.sum()) * GRAVITY_M_S2
    normal, loads = _levelled(centres_I - com_I, up_I / np.linalg.norm(up_I), model.radius_m, weight_n)
    link = np.repeat(np.arange(model.link_count), model.sphere_centres_L.shape[0])
    return Ground(normal, centres_I - model.radius_m * normal, loads, link)


@compiled
def _spheres(Ts_IL: Float, centres_L: Float, masses_kg: Float, com_L: Float) -> tuple[Float, Float]:
    """Return the middles of all links' spheres, (M, 3), and the body's centre of mass, (3,)."""
    of_link = len(centres_L)
    centres_I, com_I = np.empty((len(Ts_IL) * of_link, 3)), np.zeros(3)
    for n in range(len(Ts_IL)):
        for i in range(3):
            R_i, p_i = Ts_IL[n, i], Ts_IL[n, i, 3]
            com_I[i] += masses_kg[n] * (p_i + R_i[0] * com_L[0] + R_i[1] * com_L[1] + R_i[2] * com_L[2])
            for s in range(of_link):
                c = centres_L[s]
                centres_I[n * of_link + s, i] = p_i + R_i[0] * c[0] + R_i[1] * c[1] + R_i[2] * c[2]
    return centres_I, com_I / np.sum(masses_kg)


@compiled
def _levelled(points: Float, up: Float, radius_m: float, weight_n: float) -> tuple[Float, Float]:
    """Return the plane's normal and the loads of spheres at ``points`` (M, 3) about the centre of mass."""
    normal, loads = up, np.ones(len(points))
    for _ in range(PLANES):
        # The effective number of loaded contacts.
        bearing = max(FEWEST, np.sum(loads) ** 2 / np.sum(loads * loads))
        stiff = weight_n / (bearing * SKIN_GIVES_M)
        side = _across(normal)
        left = cross_of_two(normal, side)
        x, y, z = _along(points, side), _along(points, left), _along(points, normal)
        plane, pen = _settle(x, y, z - radius_m, weight_n, weight_n * radius_m, stiff)
        loads = stiff * np.maximum(pen, 0.0)
        normal = normal - plane[1] * side - plane[2] * left
        normal = normal / np.sqrt(np.sum(normal * normal))
    return normal, loads


@compiled
def _along(points: Float, axis: Float) -> Float:
    return points[:, 0] * axis[0] + points[:, 1] * axis[1] + points[:, 2] * axis[2]


@compiled
def _across(up: Float) -> Float:
    """Return a unit vector at a right angle to ``up``."""
    side = cross_of_two(up, X_AXIS if abs(up[0]) < 0.9 else Y_AXIS)
    return side / np.sqrt(np.sum(side * side))


@compiled
def _settle(x: Float, y: Float, lowest: Float, weight_n: float, hold_nm: float, stiff: float) -> tuple[Float, Float]:
    """Return the plane (height, slopes) that carries the weight, and the penetration of each sphere, (M,).

    Newton's method starts from a low plane on which every contact is loaded, so that none is dropped too early.
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
