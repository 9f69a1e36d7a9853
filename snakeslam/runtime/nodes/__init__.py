"""The programs that run as processes of a live session."""
