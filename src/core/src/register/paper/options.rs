//! What the public text leaves open, with our reading as the default.

use crate::register::baseline::IterationOptions;

/// Every choice of the reconstruction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperOptions {
    /// n: farthest point samples of the sampled cloud. Default 200.
    pub samples: usize,
    /// m: matching ends with so many pairs. Default 60.
    pub pairs: usize,
    /// Which cloud is sampled; the other one's points give the feature spheres. Default: the sparser.
    pub sampled: Sampled,
    /// What a point's neighbourhood is. Default: a ball of ρ = 10 cm.
    pub neighbourhood: Neighbourhood,
    /// ε: a pair's descriptors differ by less in every entry. Default 0.15.
    pub epsilon: f64,
    /// T: distances from the centroids differ by less. Default: the mean spacing.
    pub tolerance: ShellTolerance,
    /// The descriptor's entries. Default: all.
    pub entries: Entries,
    /// What the feature sphere is. Default: the moment sphere.
    pub sphere: SphereReading,
    /// How pairs are weighed in the closed form. Default: equally.
    pub weighting: Weighting,
    /// Which of the candidates that pass the gate is taken. Default: the one with the nearest descriptor.
    pub candidate: Candidate,
    /// Rounds of matching and solving. 1, the default, is the published method; in further rounds (ours) a sample's
    /// candidates are the points within ρ of it under the pose so far, instead of those in its shell.
    pub rounds: u32,
    /// Ours: refine the result with GICP. Default: no.
    pub polish: Option<IterationOptions>,
}

impl Default for PaperOptions {
    fn default() -> Self {
        Self {
            samples: 200,
            pairs: 60,
            sampled: Sampled::Sparser,
            neighbourhood: Neighbourhood::Ball { radius_m: 0.10 },
            epsilon: 0.15,
            tolerance: ShellTolerance::MeanSpacing { times: 1.0 },
            entries: Entries::all(),
            sphere: SphereReading::Moment,
            weighting: Weighting::Equal,
            candidate: Candidate::NearestDescriptor,
            rounds: 1,
            polish: None,
        }
    }
}

/// Which cloud is sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampled {
    /// The one of fewer points: the paper's reference, its LiDAR.
    Sparser,
    /// The reference, whatever it is.
    Reference,
}

/// A point's neighbourhood.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Neighbourhood {
    /// All points within ρ, m: the same for clouds of any density.
    Ball {
        /// ρ, m.
        radius_m: f64,
    },
    /// The k nearest, itself included; ρ is then the farthest one's distance. Of clouds whose densities differ tenfold
    /// these are patches of different sizes.
    Nearest {
        /// k.
        count: usize,
    },
}

/// T: how far distances from the centroids may differ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ShellTolerance {
    /// A multiple of the mean distance between nearest neighbours in the cloud that is not sampled.
    MeanSpacing {
        /// The factor.
        times: f64,
    },
    /// A length.
    Metres(f64),
}

/// Which entries the descriptor `(σ/ρ, P·S/ρ², |n·r̂|, c_l, c_p)` has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entries {
    /// σ/ρ: the feature sphere's radius. Fitted sphere: ρ/r, which is bounded where the surface is flat.
    pub radius: bool,
    /// P·S/ρ²: the product of the point with the feature sphere. Fitted sphere: P·ŝ/ρ.
    pub product: bool,
    /// |n·r̂|: the angle between normal and ray from the centroid.
    pub ray: bool,
    /// c_l: the linear shape factor.
    pub linear: bool,
    /// c_p: the planar shape factor.
    pub planar: bool,
}

impl Entries {
    /// All five.
    pub const fn all() -> Self {
        Self { radius: true, product: true, ray: true, linear: true, planar: true }
    }
}

/// What the feature sphere of a neighbourhood is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SphereReading {
    /// The mean of the conformal points with the sign of its squared radius turned: about their centroid, through their
    /// root mean square distance.
    Moment,
    /// The sphere fitted to them. One of more than ten times the neighbourhood's radius is flat, and has the moment
    /// sphere's centre: a plane has none.
    Fitted,
}

/// The weight of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weighting {
    /// 1.
    Equal,
    /// 1/(σ² + r²): noise and the feature sphere's radius.
    Radius,
}

/// Which of several candidates is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Candidate {
    /// The one with the nearest descriptor (largest difference of any entry).
    NearestDescriptor,
    /// The one whose distance from the centroid is nearest.
    NearestShell,
}
