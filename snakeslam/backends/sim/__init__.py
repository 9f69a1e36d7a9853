"""The simulator: PyBullet bodies, worlds, camera and IMU behind the backend contract."""
