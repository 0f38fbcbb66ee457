from gapeval.cli import main

main()
