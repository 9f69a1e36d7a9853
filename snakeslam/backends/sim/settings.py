"""Settings of the simulator, apart from it: a configuration is read where PyBullet is not installed too."""

from typing import Literal

from pydantic import Field

from snakeslam.settings import Settings

WorldName = Literal["corridor", "office", "rubble", "blank"]
CameraRate = Literal[1, 2, 4, 5, 8, 10, 20, 25, 40, 50, 100]
"""Rates in Hz that divide the IMU's, so that every exposure's middle is the time of an IMU sample."""

IMU_RATE_HZ = 200


class CameraSettings(Settings):
    """The RGB-D camera in the head, 640x480."""

    rate_hz: CameraRate = 20
    """Frames per second; must divide the IMU's 200 Hz."""
    horizontal_fov_deg: float = Field(default=80.0, ge=30, le=120)
    """Horizontal field of view."""
    exposure_ms: float = Field(default=8.0, ge=0, le=10)
    """Time of one exposure, for motion blur."""
    noise_grey_levels: float = Field(default=1.5, ge=0, le=50)
    """Standard deviation of the image noise, of 255."""
    depth_noise_m: float = Field(default=0.001, ge=0, le=1)
    """a of the depth noise sigma = a + b z^2, in m."""
    depth_noise_per_m: float = Field(default=0.0015, ge=0, le=1)
    """b of the depth noise sigma = a + b z^2, in 1/m."""
    depth_min_m: float = Field(default=0.25, ge=0, le=5)
    """Depth is unknown nearer than this, in m."""
    depth_max_m: float = Field(default=6.0, gt=0, le=20)
    """Depth is unknown farther than this, in m."""


class ImuSettings(Settings):
    """The IMU in the head, 200 Hz."""

    gyro_noise_density: float = Field(default=2.4e-4, gt=0, le=1)
    """White noise of the gyroscope, rad/s/sqrt(Hz)."""
    gyro_random_walk: float = Field(default=2.0e-5, gt=0, le=1)
    """Random walk of its bias, rad/s^2/sqrt(Hz)."""
    accel_noise_density: float = Field(default=1.5e-3, gt=0, le=1)
    """White noise of the accelerometer, m/s^2/sqrt(Hz)."""
    accel_random_walk: float = Field(default=3.0e-4, gt=0, le=1)
    """Random walk of its bias, m/s^3/sqrt(Hz)."""
    gyro_initial_bias_rad_s: float = Field(default=0.005, ge=0, le=1)
    """Standard deviation of the gyroscope's bias at the start, each axis."""
    accel_initial_bias_m_s2: float = Field(default=0.05, ge=0, le=5)
    """Standard deviation of the accelerometer's bias at the start, each axis."""
    gyro_range_rad_s: float = Field(default=34.9, gt=0, le=100)
    """The gyroscope saturates here (2000 deg/s)."""
    accel_range_m_s2: float = Field(default=78.5, gt=9.81, le=1000)
    """The accelerometer saturates here (8 g)."""


class PhysicsSettings(Settings):
    """How the rigid bodies, contacts and servos are stepped."""

    rate_hz: int = Field(default=400, ge=200, le=4800)
    """Physics steps per second; 200 loses the sidewinding gait, 480 and more agree to a few per cent."""
    solver_iterations: int = Field(default=12, ge=1, le=500)
    """Iterations of the contact solver in one step."""
    friction_normal: float = Field(default=0.6, gt=0, le=5)
    """Coulomb coefficient across the body."""
    friction_slip_m_s: float = Field(default=0.02, gt=0, le=1)
    """Speed below which friction grows linearly."""
    contact_stiffness_n_m: float = Field(default=2000.0, ge=200, le=1e6)
    """Stiffness of the skin at each of a link's two contacts, in N/m; it shares the weight out among the links."""
    contact_damping_n_s_m: float = Field(default=30.0, ge=0, le=1e4)
    """Damping of the skin at each contact, in N s/m; a skin too hard for the length of a step is refused."""
    servo_lag_s: float = Field(default=0.03, ge=0, le=1)
    """Time constant of the servo's answer to a command."""
    servo_reach_rad: float = Field(default=0.15, gt=0, le=3.2)
    """The command is clipped to this much from the measured angle, so that a blocked joint does not wind up."""
    servo_position_gain: float = Field(default=0.2, gt=0, le=1)
    """Gain of the servo on position."""
    servo_velocity_gain: float = Field(default=1.0, gt=0, le=1)
    """Gain of the servo on velocity."""


class SimSettings(Settings):
    """The simulated world, its physics and the robot's sensors."""

    world: WorldName = "corridor"
    """corridor, office, rubble, or blank (poor in texture)."""
    friction_ratio: float = Field(default=3.0, ge=1, le=100)
    """Friction across the body over friction along it."""
    physics: PhysicsSettings = PhysicsSettings()
    camera: CameraSettings = CameraSettings()
    imu: ImuSettings = ImuSettings()
