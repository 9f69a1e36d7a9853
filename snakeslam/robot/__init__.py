"""The robot's body: ``model`` (links, masses, frames, URDF), ``kinematics`` and ``limits``."""
