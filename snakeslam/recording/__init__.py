"""Files to messages and back: recordings of sensors, trajectories."""
