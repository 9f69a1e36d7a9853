"""The iterated error-state Kalman filter: state, IMU pre-integration, update, gating, camera extrinsics."""
