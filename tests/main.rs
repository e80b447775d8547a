//! The one integration binary: on a small machine linking is the cost, and one link is cheaper than ten.

mod architecture;
mod cli_basics;
mod config_cli;
mod config_layers;
mod schemas;
mod support;
