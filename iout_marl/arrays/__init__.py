"""What array libraries do differently, and arrays over nodes."""
