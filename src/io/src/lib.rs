//! Raw bytes from files into one ordered ledger.
