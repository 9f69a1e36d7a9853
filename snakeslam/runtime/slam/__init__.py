"""The estimator's side of a session: order of the packets, the one runner of slam, silent sensors, a restarted slam."""
