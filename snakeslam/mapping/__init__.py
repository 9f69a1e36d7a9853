"""The map: keyframes with chunks of coloured points, free distances in it, and its export."""
