"""The page for operators, as far as a run knows of it: the local socket by which its process reports, and its sessions."""
