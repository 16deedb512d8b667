"""What one unit of a regulator's gain is, in amperes at the motor shaft."""

VELOCITY_UNITS = (20e-6, 5e-3)
"""Of P [A s/rad] and I [A/rad] of the velocity regulator, whose output is the demanded current.

As the EPOS2 is documented (maxon, EPOS2 Application Notes, velocity regulation). The EPOS's documents name no units;
that its shipped gains suit the motors that it is made for with these is what speaks for them.
"""
POSITION_UNITS = (10e-3, 0.78, 80e-6)
"""Of P [A/rad], I [A/(rad s)] and D [A s/rad] of the position regulator, likewise."""
