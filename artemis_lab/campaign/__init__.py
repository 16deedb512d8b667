"""Many seeded runs in which everything may go wrong, and a monitor that judges them from outside."""
