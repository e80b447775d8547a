//! One door to every method, with the settings each has.

use super::baseline::{CbdOptions, IterationOptions, cbd, gicp, icp, plane_icp};
use super::paper::{PaperOptions, cga_paper};
use super::solve::{CgaOptions, cga};
use super::{Cloud, Method, Prior, RegisterError, Registration};
use crate::workers::Workers;

/// What each method is told.
#[derive(Clone, Debug, PartialEq)]
pub struct MethodOptions {
    /// Of [`Method::Cga`].
    pub cga: CgaOptions,
    /// Of [`Method::CgaPaper`].
    pub paper: PaperOptions,
    /// Of [`Method::Icp`] and [`Method::Gicp`].
    pub points: IterationOptions,
    /// Of [`Method::PlaneIcp`].
    pub planes: IterationOptions,
    /// Of [`Method::Cbd`].
    pub cbd: CbdOptions,
}

impl Default for MethodOptions {
    fn default() -> Self {
        Self {
            cga: CgaOptions::default(),
            paper: PaperOptions::default(),
            points: IterationOptions::points(),
            planes: IterationOptions::planes(),
            cbd: CbdOptions::default(),
        }
    }
}

impl Method {
    /// Every method, the default first.
    pub const ALL: [Self; 6] = [Self::Cga, Self::CgaPaper, Self::Icp, Self::PlaneIcp, Self::Gicp, Self::Cbd];

    /// Its name: `cga`, `cga-paper`, `icp`, `plane-icp`, `gicp` or `cbd`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Cga => "cga",
            Self::CgaPaper => "cga-paper",
            Self::Icp => "icp",
            Self::PlaneIcp => "plane-icp",
            Self::Gicp => "gicp",
            Self::Cbd => "cbd",
        }
    }

    /// The method of a name.
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|method| method.name() == name)
    }

    /// Whether it makes use of a prior. The others begin with the clouds' centroids or their descriptors.
    pub const fn takes_prior(self) -> bool {
        !matches!(self, Self::CgaPaper | Self::Cbd)
    }
}

/// Registers by a method. A prior is left aside by methods that [take none](Method::takes_prior); threads change when the
/// default method's result is there, never what it is, and nothing of the others'.
///
/// # Errors
/// Clouds or a prior that are none.
pub fn register(
    moving: &Cloud,
    reference: &Cloud,
    method: Method,
    prior: Option<&Prior>,
    options: &MethodOptions,
    workers: &Workers,
) -> Result<Registration, RegisterError> {
    match method {
        Method::Cga => cga(moving, reference, prior, &options.cga, workers),
        Method::Gicp => gicp(moving, reference, prior, &options.points),
        Method::CgaPaper => cga_paper(moving, reference, &options.paper),
        Method::Icp => icp(moving, reference, prior, &options.points),
        Method::PlaneIcp => plane_icp(moving, reference, prior, &options.planes),
        Method::Cbd => cbd(moving, reference, &options.cbd),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_method_has_a_name_of_its_own_and_is_found_by_it() {
        for method in Method::ALL {
            assert_eq!(Method::of_name(method.name()), Some(method));
        }
        assert_eq!(Method::of_name("fmr"), None);
    }
}
