"""What a session is made of, and its parts built from the settings."""
