"""The paper's motion models [Tang24]: serpentine kinematics, Eq. (28)-(31), and arc rolling, Eq. (32)-(36).

Eq. (31) is an identity: the velocity of the centre of mass and the rate of the mean heading are determined by friction.
``Rods.twist`` closes it by the balance of forces. For arc rolling there is the paper's speed and the corrected one.
"""

from dataclasses import dataclass

import numpy as np

from snakeslam.messages import Float

SLIP_M_S = 0.02
"""Speed of a contact below which its friction is proportional to it: the regularisation of Coulomb's law."""
BALANCE_ITERATIONS = 12
SMALL_TWIST = 1e-3
"""Change, in m/s and rad/s, at which the balance has converged: far below the error of the model."""
FAN_POINTS = 33
"""Points at which the integral over the arc is evaluated."""
FAN_ITERATIONS = 40


@dataclass(frozen=True, slots=True)
class Twist:
    """Motion in the plane: velocity of the centre of mass ``v`` (2,) m/s, rate of the mean heading ``omega`` rad/s.

    ``effort`` m/s is the RMS speed at which the joints move the links; the model's error is proportional to it.
    """

    v: Float
    omega: float
    effort: float


class Rods:
    """N equal rods of length 2 l joined end to end; index 0 is the tail, ``theta`` (N,) their headings in rad."""

    def __init__(self, count: int, half_length_m: float) -> None:
        self.half_length_m = half_length_m
        self.D = np.eye(count - 1, count) - np.eye(count - 1, count, 1)
        self.A = np.eye(count - 1, count) + np.eye(count - 1, count, 1)
        self.K = self.A.T @ np.linalg.solve(self.D @ self.D.T, self.D)

    def gaps(self, X: Float, Y: Float, theta: Float) -> tuple[Float, Float]:
        """Return D X + l A cos(theta) and D Y + l A sin(theta), (N - 1,) m, which are zero by Eq. (29)."""
        along = self.half_length_m * self.A @ np.array([np.cos(theta), np.sin(theta)]).T
        return self.D @ X + along[:, 0], self.D @ Y + along[:, 1]

    def positions(self, theta: Float, p: Float) -> tuple[Float, Float]:
        """Return the rods' centres X, Y (N,) for the centre of mass p (2,), Eq. (30): T^-1 [-l A cos(theta); p_x].

        T^-1 = [D^T (D D^T)^-1, e], so that X = -l K^T cos(theta) + e p_x with K = A^T (D D^T)^-1 D.
        """
        l_K_T = self.half_length_m * self.K.T
        return p[0] - l_K_T @ np.cos(theta), p[1] - l_K_T @ np.sin(theta)

    def velocities(self, theta: Float, dtheta: Float, dp: Float) -> tuple[Float, Float]:
        """Return dX/dt, dY/dt (N,) m/s, Eq. (31): l K^T S dtheta + e dp_x, -l K^T C dtheta + e dp_y."""
        l_K_T = self.half_length_m * self.K.T
        return dp[0] + l_K_T @ (np.sin(theta) * dtheta), dp[1] - l_K_T @ (np.cos(theta) * dtheta)

    def twist(self, theta: Float, dtheta: Float, load: Float, friction_ratio: float) -> Twist:
        """Return the motion at which friction balances, dp and omega of Eq. (31) with rates dtheta + omega.

        It minimises sum w (v_t^2 + c v_n^2 + c l^2/3 rate^2) over the rods, c the ratio of friction across to along,
        with w = load / sqrt(|v|^2 + slip^2) of the iteration before: Coulomb friction by iteratively re-weighted least
        squares. ``load`` (N,) >= 0.
        """
        # Weighted least squares over all rods, [A b]^T W [A b] = normal, u = -(A^T W A)^-1 A^T W b; then new weights.
        flat = self._friction_rows(theta, dtheta, friction_ratio)

        u: Float = np.zeros(3)
        weight = load
        for _ in range(BALANCE_ITERATIONS):
            before = u
            normal = (flat * np.tile(weight, 3)[:, None]).T @ flat
            u = np.asarray(-np.linalg.solve(normal[:3, :3], normal[:3, 3]), dtype=np.float64)
            if np.linalg.norm(u - before) < SMALL_TWIST:
                break
            v_t, v_n, _ = (flat @ np.append(u, 1.0)).reshape(3, -1)
            weight = load / np.sqrt(v_t**2 + v_n**2 / friction_ratio + SLIP_M_S**2)
        own = self.velocities(theta, dtheta, np.zeros(2))
        return Twist(u[:2], float(u[2]), float(np.sqrt(np.mean(own[0] ** 2 + own[1] ** 2))))

    def _friction_rows(self, theta: Float, dtheta: Float, friction_ratio: float) -> Float:
        """Return rows (3 N, 4): v_t of all rods, then sqrt(c) v_n, then sqrt(c/3) l rate.

        The columns are the coefficients of dp_x, dp_y and omega, and the constant part by the joint rates.
        """
        c, s = np.cos(theta), np.sin(theta)
        zero, one = np.zeros_like(c), np.ones_like(c)
        by_omega = self.velocities(theta, one, np.zeros(2))
        own = self.velocities(theta, dtheta, np.zeros(2))
        across, spin = np.sqrt(friction_ratio), np.sqrt(friction_ratio / 3.0) * self.half_length_m
        rows = [
            [c, s, c * by_omega[0] + s * by_omega[1], c * own[0] + s * own[1]],
            [-across * s, across * c, across * (c * by_omega[1] - s * by_omega[0]), across * (c * own[1] - s * own[0])],
            [zero, zero, spin * one, spin * dtheta],
        ]
        return np.moveaxis(np.array(rows), 1, 2).reshape(-1, 4)


def centre_of_mass(X: Float, Y: Float) -> Float:
    """Return p = 1/N [e^T X; e^T Y] (2,) m of equal rods, Eq. (28)."""
    return np.array([X.mean(), Y.mean()])


def wheel_speed(omega: float, radius_m: float) -> float:
    """Return omega r, the speed of a body that rolls, Eq. (32)."""
    return omega * radius_m


def swing_radius(length_m: float, amplitude: float, phase: float) -> float:
    """Return r_l = l sin(A/2 cos(omega t)) m of the lifted link, at the polar angle omega t = ``phase``, Eq. (33)."""
    return float(length_m * np.sin(amplitude / 2.0 * np.cos(phase)))


def swing_velocity(omega: float, length_m: float, amplitude: float, phase: float) -> tuple[float, float]:
    """Return (v_x, v_z) m/s of the lifted link, Eq. (34): d/dt (r_l cos(theta)), d/dt (r_l sin(theta))."""
    r = swing_radius(length_m, amplitude, phase)
    half, s, c = amplitude / 2.0, np.sin(phase), np.cos(phase)
    dr = -length_m * half * np.cos(half * c) * s
    return float(omega * (dr * c - r * s)), float(omega * (dr * s + r * c))


def paper_rolling_speed(omega: float, radius_m: float, length_m: float, amplitude: float, phase: float) -> float:
    """Return the speed of arc rolling, Eq. (35): v_wheel + v_x in the first half of each half period, then v_wheel."""
    if phase % np.pi <= np.pi / 2.0:
        return lifting_speed(omega, radius_m, length_m, amplitude, phase % np.pi)
    return wheel_speed(omega, radius_m)


def lifting_speed(omega: float, radius_m: float, length_m: float, amplitude: float, phase: float) -> float:
    """Return v_wheel + v_x written out, Eq. (36).

    omega r - omega l [A/2 cos(A/2 cos(omega t)) sin(omega t) cos(omega t) + sin(A/2 cos(omega t)) sin(omega t)]. A
    planar arc lies flat and lifts nothing; ``fan_rolling_speed`` is the better form.
    """
    half, s, c = amplitude / 2.0, np.sin(phase), np.cos(phase)
    swing = half * np.cos(half * c) * s * c + np.sin(half * c) * s
    return float(omega * radius_m - omega * length_m * swing)


def fan_rolling_speed(omega: float, radius_m: float, joint_count: int, amplitude: float) -> float:
    """Return V = argmin int |V - omega r n(s)| ds, the speed of an arc whose normals n fan over +-N A/4, in m/s.

    This is for Coulomb friction; viscous friction gives omega r sin(beta)/beta. It is the corrected form of Eq. (36).
    """
    beta = joint_count * amplitude / 4.0
    edges = np.linspace(-beta, beta, FAN_POINTS + 1)
    angle = 0.5 * (edges[:-1] + edges[1:])
    V = float(np.mean(np.cos(angle)))
    for _ in range(FAN_ITERATIONS):
        weight = 1.0 / np.sqrt((V - np.cos(angle)) ** 2 + np.sin(angle) ** 2 + 1e-12)
        V = float(np.sum(weight * np.cos(angle)) / np.sum(weight))
    return omega * radius_m * V
