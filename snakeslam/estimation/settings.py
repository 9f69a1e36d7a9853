"""Settings of the estimators; units are in the names."""

from typing import Annotated, Literal

from pydantic import Field

from snakeslam.estimation.filter.settings import CalibrationSettings, WindowSettings
from snakeslam.estimation.frontend.settings import FrontendSettings
from snakeslam.estimation.gait.settings import GaitSensorSettings
from snakeslam.estimation.health_settings import HealthSettings
from snakeslam.estimation.measurements.settings import NoiseSettings
from snakeslam.estimation.orb_map.settings import OrbMapSettings
from snakeslam.estimation.planar.settings import PlanarSettings
from snakeslam.estimation.visual.settings import VisualSettings
from snakeslam.settings import Settings

Positive = Annotated[float, Field(gt=0)]
Mode = Literal["visual", "vio", "planar", "fused", "gait"]


class EstimatorSettings(Settings):
    """Which estimator runs, and its parts."""

    mode: Mode = "fused"
    """visual: RGB-D camera alone; vio: camera and IMU, tightly coupled; planar: the paper's 5-D filter over the poses
    of vio and the gait's motion model; gait: that motion model alone, without camera and IMU; fused: camera, IMU and
    gait, tightly coupled."""
    max_iterations: Annotated[int, Field(ge=1, le=10)] = 3
    """Iterations of one update."""
    gravity_m_s2: Positive = 9.81
    """Gravity in m/s^2."""
    frontend: FrontendSettings = FrontendSettings()
    noise: NoiseSettings = NoiseSettings()
    window: WindowSettings = WindowSettings()
    calibration: CalibrationSettings = CalibrationSettings()
    health: HealthSettings = HealthSettings()
    relocalisation: OrbMapSettings = OrbMapSettings()
    visual: VisualSettings = VisualSettings()
    planar: PlanarSettings = PlanarSettings()
    gait: GaitSensorSettings = GaitSensorSettings()
