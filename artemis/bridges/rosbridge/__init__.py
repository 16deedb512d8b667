"""rosbridge: messages as JSON over WebSockets."""
