"""From a state of the page to what the network answers; no browser here."""
