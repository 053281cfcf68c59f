"""What every command needs: estimates over rooms, files, processes, and where a number comes from."""
