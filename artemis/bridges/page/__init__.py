"""The page for operators, as far as a run knows of it: the local socket to its process, and its sessions."""
