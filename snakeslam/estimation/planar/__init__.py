"""estimator.mode = planar: the paper's planar filter and its gait motion models, Eq. (24)-(41)."""
