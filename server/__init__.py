"""The dashboard's server: HTTP API, telemetry, and the 3D viewer behind its proxy."""
