"""For tests of plugins: the contract that each must keep, and devices in memory."""
