"""SICK laser scanners LMS1xx, by CoLa A over TCP: telegrams, the device's clock, the session with it."""
