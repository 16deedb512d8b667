"""What artemis exchanges with other programs on the network: messages first, transports around them."""
