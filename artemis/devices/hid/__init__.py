"""Input devices of the HID class: what their reports mean, who they are, and the thread that reads them."""
