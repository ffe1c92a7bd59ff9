"""Laws of the errors of pseudoranges, one file with a class that follows ``ErrorModel`` each."""
