"""The page for operators: its server in its own process, the states that browsers get, and access control."""
