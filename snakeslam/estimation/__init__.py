"""Where the head is: the visual-inertial filter, the visual baseline, and what they are made of."""
