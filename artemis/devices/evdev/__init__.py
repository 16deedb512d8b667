"""Input devices of the Linux event interface (evdev): those that hidraw does not show, and the motors of all."""
