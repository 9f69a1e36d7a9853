"""Messages between the processes: topics, wire format, transport."""
