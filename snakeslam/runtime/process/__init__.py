"""What every process needs: logs, priorities, clocks, pacing, starting and restarting child processes."""
