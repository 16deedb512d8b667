"""An operator on another computer: frames, both ends of the link, and what pairs them."""
