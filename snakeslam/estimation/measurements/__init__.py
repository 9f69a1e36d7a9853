"""What the camera and a stationary head measure of the state, each with its residual and Jacobian."""
