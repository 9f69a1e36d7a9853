"""Gaits: Eq. (1)-(2) (``parametric``), the serpenoid curve, one file for each gait (``forms``), and motion without
steps from one to the next (``blend``).
"""
