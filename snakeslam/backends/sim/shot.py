"""What has to be known of the simulation to make one frame of it, here or in another process."""

from dataclasses import dataclass

from snakeslam.messages import Float


@dataclass(frozen=True, slots=True)
class Shot:
    """A picture to be taken: poses of links 0..N (N + 1, 4, 4), the IMU's T_WI (4, 4), the camera's turn w_C rad/s."""

    t_ns: int
    seq: int
    Ts_WL: Float
    T_WI: Float
    w_C: Float
