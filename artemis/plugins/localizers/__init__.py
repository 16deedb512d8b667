"""Localizers that come with artemis: what a tracker recorded, and a tracker in a simulation."""
