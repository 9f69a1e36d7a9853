"""Sessions: a scripted run in lockstep, a recording, a live robot."""
