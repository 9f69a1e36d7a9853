"""Where the snake touches the world: the floor under its skin, worked out here, and obstacles, found by PyBullet.

The floor is most of what a snake touches. PyBullet makes three rows of its solver of each contact, two of them for a
friction that is not used, and they were three quarters of a step's time.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pybullet
from numpy.typing import NDArray

from snakeslam.backends.sim.settings import PhysicsSettings
from snakeslam.errors import InputError
from snakeslam.geometry.compiled import compiled
from snakeslam.messages import Float
from snakeslam.robot.model import SnakeModel

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Contacts:
    """Points of links that touch something: ``link`` (C,) from 0, ``point_W`` (C, 3) m, the unit normal out of what is
    touched ``normal_W`` (C, 3), and the load on the link along it, ``load_n`` (C,) N."""

    link: Indices
    point_W: Float
    normal_W: Float
    load_n: Float


class Floor:
    """The plane z = 0 under skin that gives: N = max(0, k d - c v_z) at the lowest point of each contact sphere.

    d is how far the sphere reaches into the floor and v_z the speed of its lowest point upwards. The force is that of
    the step's beginning, which throws a link of mass m up from 4 c dt / m + 2 k dt^2 / m = 4 on; InputError there.
    """

    def __init__(self, model: SnakeModel, settings: PhysicsSettings) -> None:
        self._stiffness_n_m = settings.contact_stiffness_n_m
        self._damping_n_s_m = settings.contact_damping_n_s_m
        _check(model.link_mass_kg, settings)
        spheres_com_L = model.sphere_centres_L - model.com_L
        self._link = np.repeat(np.arange(model.link_count), len(spheres_com_L))
        self._sphere_com_L = np.tile(spheres_com_L, (model.link_count, 1))
        self._normal_W = np.tile([0.0, 0.0, 1.0], (len(self._link), 1))
        self._radius_m = model.radius_m

    def contacts(self, com_W: Float, quat_xyzw: Float, twist_W: Float) -> Contacts:
        """Return what touches the floor, given the links' centres of mass, axes and twists there (v, w), (N + 1, .)."""
        link, point_W, upwards_m_s = _under_the_floor(
            self._link, self._sphere_com_L, self._radius_m, com_W, quat_xyzw, twist_W
        )
        load_n = np.maximum(-self._stiffness_n_m * point_W[:, 2] - self._damping_n_s_m * upwards_m_s, 0.0)
        return Contacts(link, point_W, self._normal_W[: len(link)], load_n)


def obstacle_contacts(body_id: int, client_id: int) -> Contacts:
    """Return the contacts that PyBullet bore in its last step."""
    found: list[Any] = [c for c in pybullet.getContactPoints(body_id, physicsClientId=client_id) if c[9] > 0.0]
    # Arrays of their own, as those of the floor are: a slice is another type to numba, and compiling for it stops the
    # robot for seconds when it first touches a wall.
    link = np.array([c[3] for c in found], dtype=np.int64) + 1
    point_W, normal_W = (np.array([c[k] for c in found], dtype=np.float64).reshape(-1, 3) for k in (5, 7))
    return Contacts(link, point_W, normal_W, np.array([c[9] for c in found], dtype=np.float64))


@compiled
def on_links(link: Indices, point_W: Float, twist_W: Float, com_W: Float, quat_xyzw: Float) -> tuple[Float, Float]:
    """Return the velocities of points of links and the links' x axes, (C, 3) each."""
    velocity_W, along_W = np.empty_like(point_W), np.empty_like(point_W)
    for c, k in enumerate(link):
        v, w, arm = twist_W[k, :3], twist_W[k, 3:], point_W[c] - com_W[k]
        velocity_W[c, 0] = v[0] + w[1] * arm[2] - w[2] * arm[1]
        velocity_W[c, 1] = v[1] + w[2] * arm[0] - w[0] * arm[2]
        velocity_W[c, 2] = v[2] + w[0] * arm[1] - w[1] * arm[0]
        x, y, z, s = quat_xyzw[k]
        along_W[c, 0] = 1.0 - 2.0 * (y * y + z * z)
        along_W[c, 1], along_W[c, 2] = 2.0 * (x * y + z * s), 2.0 * (x * z - y * s)
    return velocity_W, along_W


@compiled
def _under_the_floor(
    link: Indices, sphere_com_L: Float, radius_m: float, com_W: Float, quat_xyzw: Float, twist_W: Float
) -> tuple[Indices, Float, Float]:
    """Return link, lowest point (C, 3) and its speed upwards (C,) of the spheres that reach under z = 0.

    A sphere's centre is given from its link's centre of mass.
    """
    touching, lowest_W, upwards = np.empty_like(link), np.empty_like(sphere_com_L), np.empty(len(link))
    count = 0
    for s, k in enumerate(link):
        x, y, z, w = quat_xyzw[k]
        a, b, c = sphere_com_L[s]
        below = 2 * (x * z - w * y) * a + 2 * (y * z + w * x) * b + (1 - 2 * (x * x + y * y)) * c - radius_m
        if com_W[k, 2] + below >= 0.0:
            continue
        ahead = (1 - 2 * (y * y + z * z)) * a + 2 * (x * y - w * z) * b + 2 * (x * z + w * y) * c
        left = 2 * (x * y + w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z - w * x) * c
        lowest_W[count, 0], lowest_W[count, 1] = com_W[k, 0] + ahead, com_W[k, 1] + left
        lowest_W[count, 2] = com_W[k, 2] + below
        upwards[count] = twist_W[k, 2] + twist_W[k, 3] * left - twist_W[k, 4] * ahead
        touching[count] = k
        count += 1
    return touching[:count], lowest_W[:count], upwards[:count]


def _check(link_mass_kg: float, settings: PhysicsSettings) -> None:
    dt_s = 1.0 / settings.rate_hz
    damping, stiffness = settings.contact_damping_n_s_m, settings.contact_stiffness_n_m
    if 4.0 * damping * dt_s + 2.0 * stiffness * dt_s**2 >= 4.0 * link_mass_kg:
        raise InputError(
            "sim.physics.contact_damping_n_s_m",
            f"{damping:g} with contact_stiffness_n_m {stiffness:g} throws a robot of {link_mass_kg:g} kg a link up",
            f"4 c dt + 2 k dt^2 below {4.0 * link_mass_kg:g} kg, where dt is 1 / {settings.rate_hz} s",
        )
