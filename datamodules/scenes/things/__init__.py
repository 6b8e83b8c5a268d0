"""What stands about in generated pictures: things of streets and towns, rooms and their furniture."""
