// Times Newton's method on pinocchio's kinematics over a file of poses; lengths in metres.
//
// pinocchio MODE CHAIN POSES GUESSES OUT REPEATS. CHAIN: 8 rows of 12 doubles, the placement before each joint (which
// turns about z), the tool behind the last, and lower and upper ends of the ranges; POSES: rows of 12; GUESSES: rows of 6. Prints one line a repeat, the
// seconds of processor time a pose; OUT gets, a pose, 1 or 0 and 6 joints. MODE:
//   clik      pinocchio's documented loop: forwardKinematics, log6, computeJointJacobian, Jlog6, damped LDLT; full step
//   lean      one pass over the chain for pose and Jacobian, LU with partial pivoting, Jlog6
//   leaner    the same without Jlog6, which is the identity at the solution: as few steps next to it
//   restarts  lean, from further random joints where 100 iterations did not do
//   ranges    the same until whole turns bring every joint into its range
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <random>
#include <vector>

#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/multibody.hpp>
#include <pinocchio/spatial.hpp>

namespace pin = pinocchio;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

constexpr double CLOSE = 1e-9, DAMPING = 1e-12;
constexpr int ITERATIONS = 100, STARTS = 100;
constexpr pin::JointIndex LAST = 6;

struct Arm {
    pin::Model model;
    pin::SE3 flange_tool_inverse;
    Eigen::VectorXd q, v;
    pin::Data::Matrix6x J;
    Vector6 low, high;
    std::mt19937_64 random{1};
};

using Method = bool (*)(Arm &, pin::Data &, const pin::SE3 &);

static double now()
{
    timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

static std::vector<double> load(const char *path)
{
    FILE *file = std::fopen(path, "rb");
    if (!file || std::fseek(file, 0, SEEK_END) != 0) {
        std::exit(2);
    }
    std::vector<double> numbers(static_cast<size_t>(std::ftell(file)) / sizeof(double));
    std::rewind(file);
    if (std::fread(numbers.data(), sizeof(double), numbers.size(), file) != numbers.size()) {
        std::exit(2);
    }
    std::fclose(file);
    return numbers;
}

static pin::SE3 placement(const double *T)
{
    pin::SE3 out;
    for (int i = 0; i < 3; ++i) {
        out.rotation().row(i) << T[4 * i], T[4 * i + 1], T[4 * i + 2];
        out.translation()[i] = T[4 * i + 3];
    }
    return out;
}

// The documented loop with a full Newton step.
static bool clik(Arm &arm, pin::Data &data, const pin::SE3 &target)
{
    Matrix6 Jlog, square, J;
    for (int k = 0; k < ITERATIONS; ++k) {
        pin::forwardKinematics(arm.model, data, arm.q);
        const pin::SE3 error = data.oMi[LAST].actInv(target);
        const Vector6 e = pin::log6(error).toVector();
        if (e.norm() < CLOSE) {
            return true;
        }
        arm.J.setZero();
        pin::computeJointJacobian(arm.model, data, arm.q, LAST, arm.J);
        pin::Jlog6(error.inverse(), Jlog);
        J.noalias() = -Jlog * arm.J;
        square.noalias() = J * J.transpose();
        square.diagonal().array() += DAMPING;
        arm.v.noalias() = -J.transpose() * square.ldlt().solve(e);
        arm.q = pin::integrate(arm.model, arm.q, arm.v);
    }
    return false;
}

// computeJointJacobian leaves the joint's pose in iMf[0], so that one pass serves both.
template <bool exact>
static bool lean(Arm &arm, pin::Data &data, const pin::SE3 &target)
{
    Matrix6 Jlog, J;
    for (int k = 0; k < ITERATIONS; ++k) {
        pin::computeJointJacobian(arm.model, data, arm.q, LAST, arm.J);
        const pin::SE3 error = data.iMf[0].actInv(target);
        const Vector6 e = pin::log6(error).toVector();
        if (e.squaredNorm() < CLOSE * CLOSE) {
            return true;
        }
        if (exact) {
            pin::Jlog6(error.inverse(), Jlog);
            J.noalias() = Jlog * arm.J;
        } else {
            J = arm.J;
        }
        arm.q += J.partialPivLu().solve(e);
        if (!(arm.q.squaredNorm() < 1e12)) {
            return false;
        }
    }
    return false;
}

static bool into_ranges(Arm &arm)
{
    for (int j = 0; j < 6; ++j) {
        arm.q[j] -= 2 * M_PI * std::floor((arm.q[j] - arm.low[j]) / (2 * M_PI));
        if (arm.q[j] > arm.high[j]) {
            return false;
        }
    }
    return true;
}

template <bool ranged>
static bool restarts(Arm &arm, pin::Data &data, const pin::SE3 &target)
{
    std::uniform_real_distribution<double> share(0.0, 1.0);
    for (int start = 0; start < STARTS; ++start) {
        if (lean<true>(arm, data, target) && (!ranged || into_ranges(arm))) {
            return true;
        }
        for (int j = 0; j < 6; ++j) {
            arm.q[j] = arm.low[j] + share(arm.random) * (arm.high[j] - arm.low[j]);
        }
    }
    return false;
}

static Method method_of(const std::string &mode)
{
    return mode == "clik" ? clik
        : mode == "lean" ? lean<true>
        : mode == "leaner" ? lean<false>
        : mode == "restarts" ? restarts<false>
                             : restarts<true>;
}

extern "C" __attribute__((noinline)) bool solve_one(
    Method method, Arm &arm, pin::Data &data, const double *T, const double *guess, double *q)
{
    const pin::SE3 target = placement(T) * arm.flange_tool_inverse;
    arm.q = Eigen::Map<const Vector6>(guess);
    const bool done = method(arm, data, target);
    std::memcpy(q, arm.q.data(), sizeof(Vector6));
    return done;
}

static Arm build(const std::vector<double> &chain)
{
    Arm arm;
    pin::JointIndex parent = 0;
    for (int k = 0; k < 6; ++k) {
        parent = arm.model.addJoint(parent, pin::JointModelRZ(), placement(&chain[12 * k]), "q" + std::to_string(k + 1));
    }
    arm.flange_tool_inverse = placement(&chain[72]).inverse();
    arm.low = Eigen::Map<const Vector6>(&chain[84]);
    arm.high = Eigen::Map<const Vector6>(&chain[90]);
    arm.q = Eigen::VectorXd::Zero(6);
    arm.v = Eigen::VectorXd::Zero(6);
    arm.J = pin::Data::Matrix6x::Zero(6, 6);
    return arm;
}

int main(int argc, char **argv)
{
    if (argc != 7) {
        return 2;
    }
    Arm arm = build(load(argv[2]));
    pin::Data data(arm.model);
    const std::vector<double> poses = load(argv[3]), guesses = load(argv[4]);
    const size_t n = poses.size() / 12;
    std::vector<double> out(7 * n);
    const Method method = method_of(argv[1]);
    for (int repeat = 0; repeat < std::atoi(argv[6]); ++repeat) {
        const double start = now();
        for (size_t i = 0; i < n; ++i) {
            out[7 * i] = solve_one(method, arm, data, &poses[12 * i], &guesses[6 * i], &out[7 * i + 1]);
        }
        std::printf("%.6e\n", (now() - start) / static_cast<double>(n));
    }
    FILE *file = std::fopen(argv[5], "wb");
    if (!file || std::fwrite(out.data(), sizeof(double), out.size(), file) != out.size()) {
        return 2;
    }
    return std::fclose(file);
}
