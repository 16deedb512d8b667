"""Built-in behaviours: steps of a mission that plugins do."""
