"""What other programs use: behind `import skinlab`, and where the command line gets its parts."""
