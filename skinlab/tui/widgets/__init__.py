"""What the main screen is made of; each widget shows one part of the board."""
