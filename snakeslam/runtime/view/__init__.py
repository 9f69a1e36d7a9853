"""What the page is shown of a session."""
