"""artemis: missions for robots with maxon EPOS motor controllers on a CAN bus."""
