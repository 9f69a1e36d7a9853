"""Initial states: from a stationary head, and from a moving one."""
