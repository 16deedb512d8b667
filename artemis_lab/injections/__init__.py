"""Makes things go wrong, on purpose and repeatably: a bus, drives, plugins and a disk that fail when told to."""
