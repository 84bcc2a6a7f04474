"""Files in and out: logs, roads, vehicles, results."""
