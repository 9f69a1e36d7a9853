"""The loops that make the rooms work together."""
