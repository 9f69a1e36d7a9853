"""One file for each gait, with the object ``GAIT``; every module of this package is a gait and is found by name."""
