"""What does not go together in a scene: parts with parts (`fit`, `tetrahedra`), parts with a solver (`solver`)."""
