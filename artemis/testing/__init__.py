"""Makes things go wrong, on purpose and repeatably: a bus, drives, plugins and inputs that fail when told to."""
