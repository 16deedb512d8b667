"""Maps from laser scans: matching, loops, the pose graph, occupancy, and the files of all that."""
