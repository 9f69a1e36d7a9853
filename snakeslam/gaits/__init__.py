"""Gaits: Eq. (1)-(2) (``parametric``), the serpenoid curve, the catalogue, and motion without steps (``blend``)."""
