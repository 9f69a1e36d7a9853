"""The HTTP API, one module for each noun."""

PREFIX = "/api/v1"
