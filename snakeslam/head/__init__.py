"""Head control: closed forms for the serpentine gait, Eq. (3)-(21), and feedback on a model of the whole body."""
