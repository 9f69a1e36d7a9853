"""What the servos report of the true joints: encoder steps, rate steps, current and temperature."""

import numpy as np

from snakeslam.messages import Float, JointState

ANGLE_STEP_RAD = 2.0 * np.pi / 4096
RATE_STEP_RAD_S = 0.229 * 2.0 * np.pi / 60.0
CURRENT_STEP_A = 0.00269
TORQUE_CONSTANT_NM_A = 1.8
AMBIENT_DEGC = 25.0
IDLE_RISE_DEGC = 5.0
HEATING_DEGC_A2 = 8.0
"""Rise in the end for a steady current of one ampere."""
HEATING_TIME_S = 300.0


class ServoSensors:
    """Reads (N,) joints once per ``dt_s``; the temperature follows the square of the current."""

    def __init__(self, joint_count: int, dt_s: float) -> None:
        self._dt_s = dt_s
        self._temperature_degc = np.full(joint_count, AMBIENT_DEGC + IDLE_RISE_DEGC)

    def measure(self, t_ns: int, q_rad: Float, dq_rad_s: Float, torque_nm: Float) -> JointState:
        """Return the report of true angles (rad), rates (rad/s) and torques (N m)."""
        current_a = torque_nm / TORQUE_CONSTANT_NM_A
        settled = AMBIENT_DEGC + IDLE_RISE_DEGC + HEATING_DEGC_A2 * current_a**2
        self._temperature_degc += (settled - self._temperature_degc) * (self._dt_s / HEATING_TIME_S)
        return JointState(
            t_ns,
            np.rint(q_rad / ANGLE_STEP_RAD) * ANGLE_STEP_RAD,
            np.rint(dq_rad_s / RATE_STEP_RAD_S) * RATE_STEP_RAD_S,
            np.rint(current_a / CURRENT_STEP_A) * CURRENT_STEP_A,
            np.floor(self._temperature_degc),
        )
