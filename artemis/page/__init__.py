"""The page for operators: a server in a process of its own, what it tells browsers, and who may use it."""
