"""The hardware edge: the CAN bus and the drives on it."""
