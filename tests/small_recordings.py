"""Small recordings written by the tests: a few frames of moving texture, in the layouts of the data sets."""

from pathlib import Path

import cv2
import numpy as np

from snakeslam.recording.tum_writer import TumWriter
from tests.server.still_robot import StillRobot

EUROC_START_NS = 1_403_715_285_262_142_976
TUM_START = "1305031229"
WIDTH, HEIGHT = 64, 48

CAM_SENSOR = f"""%YAML:1.0
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, 0.1,
         1.0, 0.0, 0.0, 0.2,
         0.0, 0.0, 1.0, 0.3,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 20
resolution: [{WIDTH}, {HEIGHT}]
camera_model: pinhole
intrinsics: [50.0, 50.0, 32.0, 24.0]
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0, 0.0]
"""

IMU_SENSOR = """%YAML:1.0
sensor_type: imu
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.0,
         0.0, 1.0, 0.0, 0.0,
         0.0, 0.0, 1.0, 0.0,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 200
gyroscope_noise_density: 1.7e-04
gyroscope_random_walk: 1.9e-05
accelerometer_noise_density: 2.0e-3
accelerometer_random_walk: 3.0e-3
"""

CALIBRATION = f"""cam0:
  T_cam_imu:
    - [0.0, -1.0, 0.0, 0.0]
    - [0.0, 0.0, -1.0, 0.05]
    - [1.0, 0.0, 0.0, 0.0]
    - [0.0, 0.0, 0.0, 1.0]
  intrinsics: [50.0, 50.0, 32.0, 24.0]
  resolution: [{WIDTH}, {HEIGHT}]
  depth_scale: 5000.0
imu0:
  gyroscope_noise_density: 1.7e-04
  gyroscope_random_walk: 1.9e-05
  accelerometer_noise_density: 2.0e-3
  accelerometer_random_walk: 3.0e-3
  update_rate: 200.0
"""


def grey_image(seed: int) -> np.ndarray:
    """A blurred random texture, (HEIGHT, WIDTH) uint8."""
    noise = np.random.default_rng([seed, 7]).integers(0, 256, (HEIGHT, WIDTH), dtype=np.uint8)
    return cv2.GaussianBlur(noise, (5, 5), 1.5)


def write_euroc(folder: Path, frames: int = 4) -> Path:
    """Write ``folder/mav0`` with ``frames`` grey frames at 20 Hz, an IMU at 200 Hz, truth at 20 Hz."""
    root = folder / "mav0"
    for name in ("cam0/data", "imu0", "state_groundtruth_estimate0"):
        (root / name).mkdir(parents=True)
    (root / "cam0/sensor.yaml").write_text(CAM_SENSOR)
    (root / "imu0/sensor.yaml").write_text(IMU_SENSOR)
    stamps = [EUROC_START_NS + 50_000_000 * k for k in range(frames)]
    for k, t_ns in enumerate(stamps):
        cv2.imwrite(str(root / f"cam0/data/{t_ns}.png"), grey_image(k))
    images = "".join(f"{t_ns},{t_ns}.png\n" for t_ns in stamps)
    (root / "cam0/data.csv").write_text(f"#timestamp [ns],filename\n{images}")
    imu = "".join(f"{stamps[0] + 5_000_000 * k},0.01,0.02,0.03,0.1,0.2,9.8\n" for k in range(10 * (frames - 1) + 1))
    (root / "imu0/data.csv").write_text(f"#timestamp [ns],wx,wy,wz,ax,ay,az\n{imu}")
    truth = "".join(f"{t},{k},0,0,1,0,0,0,1,0,0,.1,.2,.3,.4,.5,.6\n" for k, t in enumerate(stamps))
    (root / "state_groundtruth_estimate0/data.csv").write_text(f"#timestamp,p,q,v,bw,ba\n{truth}")
    return folder


def write_tum(folder: Path, frames: int = 4, calibrated: bool = True, imu: bool = False) -> Path:
    """Write a TUM RGB-D folder with ``frames`` frames at 20 Hz, depth 1 m and 4 ms late, truth at 20 Hz."""
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True)
    rgb, depth, truth = ["# colour images"], ["# depth maps"], ["# truth"]
    for k in range(frames):
        stamp, late = f"{TUM_START}.{50 * k:03d}123", f"{TUM_START}.{50 * k + 4:03d}123"
        colour = cv2.merge([grey_image(k + offset) for offset in (0, 50, 90)])
        cv2.imwrite(str(folder / f"rgb/{stamp}.png"), colour)
        cv2.imwrite(str(folder / f"depth/{late}.png"), np.full((HEIGHT, WIDTH), 5000, np.uint16))
        rgb.append(f"{stamp} rgb/{stamp}.png")
        depth.append(f"{late} depth/{late}.png")
        truth.append(f"{stamp} {k} 0 0 0 0 0 1")
    (folder / "rgb.txt").write_text("\n".join(rgb) + "\n")
    (folder / "depth.txt").write_text("\n".join(depth) + "\n")
    (folder / "groundtruth.txt").write_text("\n".join(truth) + "\n")
    if calibrated:
        (folder / "calibration.yaml").write_text(CALIBRATION)
    if imu:
        start_ns = int(TUM_START) * 10**9
        rows = "".join(f"{start_ns + 5_000_000 * k},0,0,0.5,0,0,9.81\n" for k in range(10 * frames))
        (folder / "imu.csv").write_text(f"t_ns,gx,gy,gz,ax,ay,az\n{rows}")
    return folder


def write_robot(folder: Path, seconds: float = 2.0) -> Path:
    """Write what the sensors of a robot at rest gave: RGB-D at 20 Hz, IMU and joints at 100 Hz, and the truth."""
    robot = StillRobot(end_s=seconds)
    writer = TumWriter(folder, robot.rig, robot.model, seed=3)
    while (packets := robot.step(None)) is not None:
        for packet in packets:
            writer.add(packet)
    writer.finish(robot.read_ground_truth())
    return folder
