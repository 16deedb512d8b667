"""What artemis tells other programs on the network, and how: messages first, transports around them."""
